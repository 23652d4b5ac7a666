import csv
import io
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image

from aprjax.cli.main import main
from aprjax.io.logs import read_log
from aprjax.io.tables import HYPOTHESIS_COLUMNS
from aprjax.io.trajectory import read_tum
from aprjax.plane import relative
from aprjax.tracking import replay, tracker
from aprjax.tracking.continuity import ScanContinuity
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place
from aprjax.world.store import save_map
from tests.make_logs import laser_line
from tests.worlds import office, scan_at

START = np.array([2.0, 2.0, 0.3])
SECOND = START + np.array([0.6, 0.3, 0.0])


def path_of(steps):
    """Poses of a robot that goes ahead slowly and turns a little."""
    poses = [START]
    for _ in range(steps - 1):
        x, y, theta = poses[-1]
        poses.append(np.array([x + 0.15 * np.cos(theta), y + 0.15 * np.sin(theta), theta + 0.05]))
    return np.array(poses)


def office_map(plan, rng, alone=0):
    """Two nodes with a reference each, after so many that no arcs lead to."""
    world, first = WorldModel(), alone
    for _ in range(alone):
        world.add_node()
    world.add_node(5)
    world.add_node(9)
    T_world_node = np.array([START, SECOND])
    T_a_b = relative(T_world_node[0], T_world_node[1])
    world.add_arc(Arc(first, first + 1, T_a_b, 1e-4 * np.eye(3), "driven"))
    world.add_references(
        [scan_at(plan, pose, noise=0.01, rng=rng) for pose in T_world_node],
        [Appearance(Place(first + k, np.zeros(3)), scan) for k, scan in enumerate((5, 9))],
    )
    return world


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """The paths of a map made by hand, and of a log whose scans were taken in it."""
    folder = tmp_path_factory.mktemp("drive")
    plan, rng = office(seed=3), np.random.default_rng(1)
    save_map(office_map(plan, rng), folder / "office.map")
    lines = [
        laser_line(scan_at(plan, pose, noise=0.01, rng=rng), relative(START, pose), 0.5 * k)
        for k, pose in enumerate(path_of(8))
    ]
    (folder / "track.log").write_text("".join(lines))
    return folder / "office.map", folder / "track.log"


@pytest.fixture(scope="module")
def outputs(drive, truth_instead_of_matcher, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    table, tum = folder / "table.csv", folder / "track.tum"
    assert main(["localize", *map(str, drive), "--out", str(table), "--tum", str(tum)]) == 0
    return table, tum


class Found(NamedTuple):
    """The fields of a `MatchResult` that tracking looks at."""

    reference: np.ndarray
    T_ref_query: np.ndarray
    covariance: np.ndarray
    probability: np.ndarray
    valid: np.ndarray


@pytest.fixture(scope="module", autouse=True)
def truth_instead_of_matcher(drive):
    """The matcher costs a minute of compilation; here it is one that knows every scan's pose."""
    known = np.array([entry.scan.ranges for entry in read_log(drive[1])])
    poses = path_of(8)

    def know(scans, references, config):
        found = []
        for ranges in scans.ranges:
            where = [k for k in range(8) if np.array_equal(ranges, known[k])]
            T = relative(START, poses[where[0]]) if where else np.zeros(3)
            found.append((T, bool(where)))
        count = len(found)
        return Found(
            reference=np.zeros((count, 1), int),
            T_ref_query=np.array([[T] for T, _ in found]),
            covariance=np.zeros((count, 1, 3, 3)),
            probability=np.full((count, 1), 0.95),
            valid=np.array([[valid] for _, valid in found]),
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(replay, "match_batch", know)
        patch.setattr(WorldModel, "references", None)
        # Aligning scans compiles too; this source measures nothing.
        patch.setattr(tracker, "ScanMotion", lambda features: ScanContinuity())
        yield


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_the_table_has_the_columns_that_were_promised_and_rows_for_every_scan(outputs):
    text = outputs[0].read_text()
    assert text.splitlines()[0] == ",".join(HYPOTHESIS_COLUMNS)
    assert ",".join(HYPOTHESIS_COLUMNS).startswith(
        "scan,rank,reference,x,y,theta,radius,angle,probability,rest,"
    )
    rows = rows_of(text)
    assert sorted({int(row["scan"]) for row in rows}) == list(range(8))
    for scan in range(8):
        mine = [row for row in rows if int(row["scan"]) == scan]
        assert [int(row["rank"]) for row in mine] == list(range(len(mine)))
        values = [float(row["probability"]) for row in mine if row["reference"]]
        assert values == sorted(values, reverse=True)
        assert sum(values) + float(mine[0]["rest"]) == pytest.approx(1, abs=1e-9)
        assert len({row["rest"] for row in mine}) == 1


def test_references_are_numbered_as_in_the_log_that_the_map_was_built_from(outputs):
    named = {row["reference"] for row in rows_of(outputs[0].read_text()) if row["reference"]}
    assert named == {"5"}


def test_the_robot_is_found_where_it_is_and_committed_to(outputs):
    last = next(row for row in rows_of(outputs[0].read_text()) if row["scan"] == "7")
    expected = relative(START, path_of(8)[-1])
    found = [float(last[column]) for column in ("x", "y", "theta")]
    np.testing.assert_allclose(found, expected, atol=0.1)
    assert last["situation"] == "tracking"


def test_the_trajectory_holds_the_scans_after_which_the_robot_is_tracked(outputs):
    tracked = [
        int(row["scan"])
        for row in rows_of(outputs[0].read_text())
        if row["rank"] == "0" and row["situation"] == "tracking"
    ]
    stamps, poses = read_tum(outputs[1])
    np.testing.assert_allclose(stamps, 0.5 * np.array(tracked))
    # The map's frame is that of its first node, where the robot started.
    np.testing.assert_allclose(poses[-1], relative(START, path_of(8)[-1]), atol=0.1)


def test_what_lies_in_other_parts_of_the_map_is_counted_where_it_is_left_out(
    drive, outputs, tmp_path, command
):
    parts, tum = tmp_path / "parts.map", tmp_path / "f.tum"
    save_map(office_map(office(seed=3), np.random.default_rng(1), alone=1), parts)
    options = ["--tum", tum, "--pictures", tmp_path / "pictures", "--cycles", "8"]
    status, _, err = command("localize", parts, drive[1], "--out", tmp_path / "t.csv", *options)
    assert status == 0
    tracked = len(read_tum(outputs[1])[0])
    assert tracked > 0
    assert err.splitlines()[:-1] == [
        f"{tum}: {tracked} of {tracked} poses left out: no arcs lead there from node 0",
        f"{parts}: 2 of 3 nodes left out: no arcs lead there from node 0",
    ]
    assert tum.read_text().splitlines() == ["# stamp x y z qx qy qz qw"]


def test_one_line_sums_up_and_standard_output_takes_the_table(drive, outputs, command):
    status, out, err = command("localize", *drive, "--out", "-")
    assert status == 0
    assert out == outputs[0].read_text()
    assert "8 scans" in err.splitlines()[-1]


def test_the_scans_after_a_piece_are_matched_as_those_in_it(
    drive, outputs, tmp_path, command, monkeypatch
):
    monkeypatch.setattr(replay, "PIECE", 4)
    assert command("localize", *drive, "--out", tmp_path / "t.csv")[0] == 0
    assert len(rows_of((tmp_path / "t.csv").read_text())) == len(rows_of(outputs[0].read_text()))


@pytest.mark.parametrize(
    ("words", "status", "text"),
    [
        (["nothing.map", "{log}", "--out", "{out}"], 1, "nothing.map"),
        (["{log}", "{log}", "--out", "{out}"], 1, "track.log"),
        (["{map}", "nothing.log", "--out", "{out}"], 1, "nothing.log"),
        (["{map}", "{map}", "--out", "{out}"], 1, "office.map"),
        (["{map}", "{log}", "--out", "{log}"], 1, "would overwrite"),
        (["{map}", "{log}", "--out", "{out}", "--tum", "{map}"], 1, "would overwrite"),
        (["{map}", "{log}"], 2, "--out"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(drive, tmp_path, command, words, status, text):
    names = {"map": drive[0], "log": drive[1], "out": tmp_path / "t.csv"}
    found, out, err = command("localize", *(word.format(**names) for word in words))
    assert found == status
    assert text in err.splitlines()[-1]
    assert out == ""
    assert not (tmp_path / "t.csv").exists()


def test_a_log_without_odometry_is_refused(drive, tmp_path, command):
    log = tmp_path / "flaser.log"
    log.write_text("FLASER 3 1.0 1.0 1.0 0 0 0 0 0 0 1.0 host 1.0\n")
    status, _, err = command("localize", drive[0], log, "--out", tmp_path / "t.csv")
    assert status == 1
    assert "no odometry" in err


def test_a_map_without_references_is_refused(drive, tmp_path, command):
    empty = WorldModel()
    empty.add_node()
    save_map(empty, tmp_path / "empty.map")
    status, _, err = command(
        "localize", tmp_path / "empty.map", drive[1], "--out", tmp_path / "t.csv"
    )
    assert status == 1
    assert "no reference scans" in err


def test_pictures_are_drawn_after_the_cycles_asked_for_and_a_film_of_the_run(
    drive, tmp_path, command
):
    folder, film = tmp_path / "pictures", tmp_path / "run.gif"
    options = ["--pictures", folder, "--cycles", "1,8,30", "--gif", film]
    assert command("localize", *drive, "--out", tmp_path / "t.csv", *options)[0] == 0
    # There is no thirtieth scan.
    assert sorted(path.name for path in folder.iterdir()) == ["cycle-0001.png", "cycle-0008.png"]
    assert film.read_bytes()[:3] == b"GIF"
    assert Image.open(film).n_frames == 8


@pytest.mark.usefixtures("outputs", "full_disk")
@pytest.mark.parametrize("option", ["--out", "--tum", "--gif"])
def test_a_full_disk_is_one_line_and_leaves_no_half_file(drive, tmp_path, command, option):
    words = {"--out": "/dev/null"} | {option: tmp_path / "file"}
    status, _, err = command("localize", *drive, *(word for pair in words.items() for word in pair))
    assert (status, err) == (1, f"aprjax: {tmp_path / 'file'}: File too large\n")
    assert not list(tmp_path.iterdir())
