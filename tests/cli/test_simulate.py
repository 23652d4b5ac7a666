import csv

import jax
import numpy as np
import pytest

import aprjax.cli.lab as cli_lab
from aprjax.cli.main import main
from aprjax.io.logs import read_log
from aprjax.io.trajectory import read_tum
from aprjax.sim.lab import lab
from aprjax.sim.laser import Laser

SMALL = ("--seed", "3", "--references", "4", "--scans", "20")
RUNS = {"references": 4, "first": 1405, "second": 20}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What a small lab was written to; the folder above it was not there either."""
    folder = tmp_path_factory.mktemp("simulate") / "new" / "folder"
    assert main(["simulate", "--out", str(folder), *SMALL]) == 0
    return folder


@pytest.fixture(scope="module")
def runs():
    """The same lab."""
    built = lab(3, 4, 20, Laser.sick(0.5))
    return {"references": built.references, "first": built.reference_run, "second": built.queries}


def test_each_run_is_a_log_a_trajectory_and_headings(folder):
    names = {path.name for path in folder.iterdir()}
    assert names == {f"{run}.{kind}" for run in RUNS for kind in ("log.gz", "tum", "gyro.csv")}


@pytest.mark.parametrize("name", RUNS)
def test_the_log_holds_the_scans_by_the_bit(folder, runs, name):
    log = read_log(folder / f"{name}.log.gz", strict=True)
    assert log.report.scans == RUNS[name]
    scans = runs[name].scans
    for i, entry in enumerate(log):
        expected = jax.tree.map(lambda array: array[i], scans)  # noqa: B023
        too_near = np.isneginf(expected.ranges)
        np.testing.assert_array_equal(
            entry.scan.ranges, np.where(too_near, np.nan, expected.ranges)
        )
        for field in ("angle_min", "angle_increment", "range_min", "range_max", "beams"):
            assert getattr(entry.scan, field) == getattr(expected, field), field


@pytest.mark.parametrize("name", ["first", "second"])
def test_the_log_holds_the_odometry_and_nothing_of_the_truth(folder, runs, name):
    run, entries = runs[name], list(read_log(folder / f"{name}.log.gz"))
    read = np.array([entry.odometry for entry in entries])
    np.testing.assert_allclose(read[:, :2], run.odometry[:, :2], atol=1e-5)
    turn = np.exp(1j * read[:, 2]) / np.exp(1j * run.odometry[:, 2])
    np.testing.assert_allclose(np.angle(turn), 0, atol=1e-5)
    logged = np.array([entry.logged_pose for entry in entries])
    np.testing.assert_allclose(logged, run.odometry, atol=1e-6)
    np.testing.assert_allclose([entry.stamp for entry in entries], run.stamps, atol=1e-6)


@pytest.mark.parametrize("name", RUNS)
def test_the_truth_and_the_headings_lie_beside_it(folder, runs, name):
    stamps, poses = read_tum(folder / f"{name}.tum")
    run = runs[name]
    np.testing.assert_allclose(stamps, run.stamps, atol=1e-6)
    np.testing.assert_allclose(poses[:, :2], run.T_world_laser[:, :2], atol=1e-8)
    turn = np.exp(1j * poses[:, 2]) / np.exp(1j * run.T_world_laser[:, 2])
    np.testing.assert_allclose(np.angle(turn), 0, atol=1e-8)
    with (folder / f"{name}.gyro.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_allclose([float(row["stamp"]) for row in rows], run.stamps, atol=1e-6)
    np.testing.assert_allclose([float(row["heading"]) for row in rows], run.gyro, atol=1e-8)


def test_the_same_seed_gives_the_same_bytes_and_the_messages_go_to_standard_error(
    folder, tmp_path, command
):
    status, out, err = command("simulate", "--out", tmp_path, *SMALL)
    assert (status, out) == (0, "")
    assert err.splitlines()[1:] == [
        f"{tmp_path / name}.log.gz: {count} scans" for name, count in RUNS.items()
    ]
    for path in folder.iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("words", "beams", "first", "step"),
    [
        ((), 361, -90.0, 0.5),
        (("--resolution", "1"), 181, -90.0, 1.0),
        (("--laser", "full-turn"), 720, -180.0, 0.5),
        (("--laser", "full-turn", "--resolution", "1"), 360, -180.0, 1.0),
    ],
)
def test_the_options_choose_the_laser_and_the_numbers(
    tmp_path, command, monkeypatch, words, beams, first, step
):
    asked = []

    def refuse(seed, references, queries, laser):
        asked.append((seed, references, queries))
        assert laser.beams == beams
        assert float(np.degrees(laser.angle_min)) == pytest.approx(first)
        assert float(np.degrees(laser.angle_increment)) == pytest.approx(step)
        raise KeyboardInterrupt

    monkeypatch.setattr(cli_lab, "lab", refuse)
    assert command("simulate", "--out", tmp_path, *words)[0] == 130
    assert command("simulate", "--out", tmp_path, *SMALL, *words)[0] == 130
    assert asked == [(0, 30, 1405), (3, 4, 20)]


def forbid_simulating(monkeypatch):
    def never(*arguments):
        raise AssertionError("the simulation was started")

    monkeypatch.setattr(cli_lab, "lab", never)


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--out"],
        ["--out", "x", "--seed", "-1"],
        ["--out", "x", "--seed", "1.5"],
        ["--out", "x", "--seed", "2147483648"],
        ["--out", "x", "--references", "0"],
        ["--out", "x", "--references", "1406"],
        ["--out", "x", "--scans", "0"],
        ["--out", "x", "--scans", "many"],
        ["--out", "x", "--laser", "velodyne"],
        ["--out", "x", "--resolution", "0.25"],
        ["--out", "x", "more"],
    ],
)
def test_bad_usage(command, monkeypatch, tmp_path, words):
    forbid_simulating(monkeypatch)
    monkeypatch.chdir(tmp_path)
    status, out, err = command("simulate", *words)
    assert (status, out) == (2, "")
    assert err.startswith("usage: aprjax")
    assert err.splitlines()[-1].startswith("aprjax")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("place", ["file", "file/below", "x" * 300])
def test_a_folder_that_cannot_be_written_is_found_before_simulating(
    command, monkeypatch, tmp_path, place
):
    forbid_simulating(monkeypatch)
    (tmp_path / "file").write_text("")
    status, out, err = command("simulate", "--out", tmp_path / place)
    assert (status, out) == (1, "")
    assert err.startswith(f"aprjax: {tmp_path / place}: cannot be written: ")
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_file_that_cannot_be_replaced_is_one_line_and_leaves_nothing_half_written(
    command, tmp_path
):
    (tmp_path / "first.tum").mkdir()
    status, _, err = command("simulate", "--out", tmp_path, *SMALL)
    assert status == 1
    assert err.splitlines()[-1].startswith("aprjax: ")
    assert {path.name for path in tmp_path.iterdir()} == {
        *("references.log.gz", "references.tum", "references.gyro.csv"),
        *("first.log.gz", "first.tum"),
    }


def test_help(command):
    status, out, _ = command("simulate", "--help")
    assert status == 0
    assert out.startswith("usage: aprjax simulate")
