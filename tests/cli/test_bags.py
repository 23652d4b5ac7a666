import json

import numpy as np
import pytest

from aprjax.cli import inputs
from aprjax.io.logs import read_log
from aprjax.io.trajectory import write_tum
from tests.io.bags import STORAGES, Bag

RANGES = np.linspace(1.0, 5.0, 181)


def bag_of(log, storage: str) -> Bag:
    """A bag of the scans and the odometry of a log."""
    bag = Bag(storage)
    for number, entry in enumerate(read_log(log), 1):
        scan = entry.scan
        limits = {name: float(getattr(scan, name)) for name in
                  ("angle_min", "angle_increment", "range_min", "range_max")}  # fmt: skip
        bag.scan(scan.ranges, 0.5 * number, **limits).odometry(entry.odometry, 0.5 * number)
    return bag


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_of_the_same_drive_is_the_same_to_every_command(logs, tmp_path, storage):
    path = bag_of(logs[1], storage).write(tmp_path)
    here, _ = inputs.read_entries(logs[1], None, None)
    there, report = inputs.read_entries(path, None, None)
    assert report.kind == "ROS bag"
    for mine, theirs in zip(here, there, strict=True):
        np.testing.assert_array_equal(theirs.scan.ranges, mine.scan.ranges)
        np.testing.assert_allclose(theirs.odometry, mine.odometry, atol=1e-9)
        for name in ("angle_min", "angle_increment", "range_min", "range_max", "beams"):
            assert getattr(theirs.scan, name) == getattr(mine.scan, name)


def test_bags_are_matched_as_logs_are(logs, tmp_path, command):
    bags = [bag_of(log, "sqlite3").write(tmp_path, log.stem) for log in logs]
    status, expected, _ = command("match", *logs, "--out", "-")
    assert status == 0
    status, table, _ = command("match", *bags, "--out", "-", "--topic", "/scan")
    assert (status, table) == (0, expected)


def test_topics_of_references_and_queries_are_chosen_apart(logs, tmp_path, command):
    two = bag_of(logs[1], "mcap").scan(RANGES, topic="/back").write(tmp_path)
    _, expected, _ = command("match", *logs, "--out", "-")
    chosen = ("--topic", "/scan", "--reference-topic", "ROBOTLASER1")
    assert command("match", logs[0], two, "--out", "-", *chosen)[:2] == (0, expected)
    status, _, err = command("match", logs[0], two, "--out", "-", *chosen[:2])
    assert status == 1
    assert "'/scan' is none of ROBOTLASER1" in err


def test_a_sweep_takes_the_truth_of_a_bag_from_a_trajectory(logs, tmp_path, command):
    axis = ("--set", "confident=0.1:0.3:2")
    assert command("sweep", *logs, *axis, "--out", tmp_path / "logs")[0] == 0
    bags, truth = [], []
    for log, scans in zip(logs, ("reference", "query"), strict=True):
        entries = list(read_log(log))
        bags.append(bag_of(log, "mcap").write(tmp_path, scans))
        truth += [f"--{scans}-poses", tmp_path / f"{scans}.tum"]
        stamps = 0.5 * np.arange(1, 1 + len(entries))
        write_tum(truth[-1], stamps, np.array([entry.logged_pose for entry in entries]))
    status, _, err = command("sweep", *bags, *axis, "--out", tmp_path / "none")
    assert (status, err.count("\n")) == (1, 1)
    assert "query: states no poses of its scans" in err
    assert command("sweep", *bags, *axis, *truth, "--out", tmp_path / "bags")[0] == 0
    tables = [(tmp_path / name / "sweep.csv").read_text() for name in ("logs", "bags")]
    assert tables[0] == tables[1]
    short = (*truth[:3], tmp_path / "reference.tum")
    status, _, err = command("sweep", *bags, *axis, *short, "--out", tmp_path / "none")
    assert (status, err.count("\n")) == (1, 1)
    assert "reference.tum: from 0.500 to 4.000 s; scan 9 of" in err


def test_info_lists_the_topics_and_describes_the_scans(tmp_path, command):
    bag = Bag("mcap").scan(RANGES).scan(RANGES, 2.0).odometry([0, 0, 0])
    bag.transform("base_link", "laser", [0.2, 0.0, 0.0])
    path = bag.write(tmp_path)
    facts = json.loads(command("info", path, "--json")[1])
    assert facts["kind"] == "ROS bag"
    assert "/scan sensor_msgs/msg/LaserScan 2" in facts["topics"]
    assert (facts["messages"], facts["scans"], facts["beams"]) == (4, 2, 181)
    assert (facts["odometry"], facts["odometry_topic"]) == (True, "/odom")
    assert facts["mounted_at"] == {"/scan": [0.2, 0.0, 0.0]}
    assert facts["damaged_messages"] == 0
    status, out, _ = command("info", path)
    assert status == 0
    assert "mounted at: /scan at 0.2 0.0 0.0" in out


def test_a_laser_is_not_mounted_twice(tmp_path, command):
    bag = Bag("mcap").scan(RANGES).scan(RANGES, 2.0).odometry([0, 0, 0]).odometry([1, 0, 0], 2.0)
    path = bag.transform("base_link", "laser", [0.2, 0.0, 0.0]).write(tmp_path)
    words = "map", "build", path, "--laser", "0.2,0,0", "--out", tmp_path / "out"
    status, _, err = command(*words)
    assert status == 1
    assert err == f"aprjax: --laser: {path} itself says where its laser sits\n"


def test_of_several_topics_one_has_to_be_chosen(tmp_path, command):
    path = Bag("ros1").scan(RANGES, topic="/a").scan(RANGES[:90], topic="/b").write(tmp_path)
    facts = json.loads(command("info", path, "--json")[1])
    assert list(facts) == ["file", "kind", "topics"]
    facts = json.loads(command("info", path, "--json", "--topic", "/b")[1])
    assert (facts["beams"], facts["scans_of_other_lasers"]) == (90, 1)
    out = tmp_path / "out"
    for words, message in [
        (("match", path, path, "--out", out), "several topics of laser scans, choose one: /a (1)"),
        (("map", "build", path, "--out", out), "several topics of laser scans"),
        (("map", "build", path, "--out", out, "--topic", "/a"), "there is no odometry"),
        (("info", path, "--topic", "/c"), "'/c' is no topic of laser scans"),
        (("info", path, "--topic", "/a", "--odometry", "/d"), "'/d' is no topic of odometry"),
        (("info", tmp_path), "a folder without metadata.yaml"),
    ]:
        status, _, err = command(*words)
        assert status == 1, words
        assert message in err
        assert len(err.splitlines()) == 1
    assert not out.exists()


def test_a_laser_message_of_a_carmen_log_is_chosen_the_same_way(tmp_path, command):
    path = tmp_path / "a.log"
    path.write_text("FLASER 2 1 1 0 0 0 0 0 0 0 h 0\nRLASER 3 1 1 1 0 0 0 0 0 0 0 h 0\n")
    assert json.loads(command("info", path, "--json")[1])["beams"] == 2
    assert json.loads(command("info", path, "--json", "--topic", "RLASER")[1])["beams"] == 3
    status, _, err = command("info", path, "--topic", "/scan")
    assert status == 1
    assert "'/scan' is none of ROBOTLASER1" in err
