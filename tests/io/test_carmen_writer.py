import gzip
from typing import Any

import equinox as eqx
import numpy as np
import pytest

from aprjax.io.carmen_writer import write_log
from aprjax.io.logs import read_log
from aprjax.scan import Scan

RUNS = {
    "half turn, one degree": (181, -np.pi / 2, np.pi / 180),
    "half turn, half a degree": (361, -np.pi / 2, np.pi / 360),
    "full turn": (360, -np.pi, np.pi / 180),
    "upside down": (541, 2.3561945, -np.radians(0.5)),
}
COUNT = 40


def run_of(beams, start, step, seed=0) -> dict[str, Any]:
    """A run of 40 scans, ranges of whole millimetres, with every kind of beam in it."""
    rng = np.random.default_rng(seed)
    ranges = rng.integers(50, 29_990, (COUNT, beams)).astype(np.float32) / np.float32(1000)
    kinds = rng.uniform(size=ranges.shape)
    for below, value in ((0.2, np.inf), (0.1, np.nan), (0.06, -np.inf), (0.03, 31.0), (0.01, 0.01)):
        ranges[kinds < below] = value
    each = [Scan.make(r, angle_min=start, angle_increment=step, range_max=30.0) for r in ranges]
    scans = Scan.stack(each)
    steps = rng.normal([0.1, 0.0, 0.02], 0.03, (COUNT - 1, 3))
    odometry = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return {"scans": scans, "odometry": odometry, "stamps": 1e9 + 0.2 * np.arange(COUNT)}


@pytest.fixture
def run():
    return run_of(*RUNS["half turn, one degree"])


def expected_ranges(scans, i):
    """What the docstring promises of scan `i`: hits and no returns, all else NaN."""
    ranges = np.asarray(scans.ranges)[i, : int(scans.beams[i])]
    inside = (ranges >= 0.02) & (ranges <= scans.range_max[i])
    return np.where(inside | np.isposinf(ranges), ranges, np.nan)


@pytest.mark.parametrize("name", RUNS)
def test_scans_come_back_by_the_bit(tmp_path, name):
    run = run_of(*RUNS[name])
    write_log(tmp_path / "run.log.gz", **run)
    log = read_log(tmp_path / "run.log.gz", strict=True)
    assert (log.report.scans, log.report.unknown, log.report.saturations) == (COUNT, {}, {})
    scans = run["scans"]
    for i, entry in enumerate(log):
        np.testing.assert_array_equal(entry.scan.ranges, expected_ranges(scans, i))
        for field in ("angle_min", "angle_increment", "range_min", "range_max", "beams"):
            assert getattr(entry.scan, field) == getattr(scans, field)[i], field


def test_ranges_need_not_be_whole_millimetres(tmp_path, run):
    rng = np.random.default_rng(1)
    ranges = rng.uniform(0.5, 29, run["scans"].ranges.shape).astype(np.float32)
    run["scans"] = ranges_of(run["scans"], ranges)
    write_log(tmp_path / "run.log", **run)
    for i, entry in enumerate(read_log(tmp_path / "run.log")):
        np.testing.assert_array_equal(entry.scan.ranges, ranges[i, :181])


def test_scans_of_different_widths_share_a_log(tmp_path, run):
    beams = np.arange(COUNT, dtype=np.int32) + 100
    run["scans"] = eqx.tree_at(lambda scans: scans.beams, run["scans"], beams)
    write_log(tmp_path / "run.log", **run)
    read = [entry.scan for entry in read_log(tmp_path / "run.log")]
    assert [scan.ranges.shape for scan in read] == [(count,) for count in beams]


def test_odometry_and_stamps_come_back_to_six_decimals(tmp_path, run):
    run["odometry"][:, 2] += np.linspace(0, 20, COUNT)  # several turns
    write_log(tmp_path / "run.log", **run)
    log = read_log(tmp_path / "run.log")
    entries = list(log)
    read = np.array([entry.odometry for entry in entries])
    np.testing.assert_allclose(read[:, :2], run["odometry"][:, :2], atol=5e-6)
    turn = np.exp(1j * read[:, 2]) / np.exp(1j * run["odometry"][:, 2])
    np.testing.assert_allclose(np.angle(turn), 0, atol=5e-6)
    np.testing.assert_allclose([entry.stamp for entry in entries], run["stamps"], atol=1e-6, rtol=0)
    assert log.report.moved == COUNT - 1


def test_odometry_that_starts_elsewhere_is_read_from_its_first_scan_on(tmp_path, run):
    run["odometry"] += [3.0, -4.0, 0.0]
    write_log(tmp_path / "run.log", **run)
    read = np.array([entry.odometry for entry in read_log(tmp_path / "run.log")])
    np.testing.assert_allclose(read[:, :2], run["odometry"][:, :2] - [3.0, -4.0], atol=5e-6)


def test_no_line_states_another_pose_than_the_odometry(tmp_path, run):
    write_log(tmp_path / "run.log", **run)
    poses = {" ".join(f"{value:.6f}" for value in pose) for pose in run["odometry"]}
    for line in (tmp_path / "run.log").read_text().splitlines():
        words = line.split()
        if words[0] == "ODOM":
            assert " ".join(words[1:4]) in poses
        elif words[0] == "ROBOTLASER1":
            assert words[-14:-11] == words[-11:-8]
            assert " ".join(words[-14:-11]) in poses
        else:
            assert words[0] == "#"


def test_the_bytes_are_the_same_every_time_and_gzip_changes_nothing(tmp_path, run):
    for name in ("a.log", "a.log.gz", "b.log.gz"):
        write_log(tmp_path / name, **run)
    packed = (tmp_path / "a.log.gz").read_bytes()
    assert packed == (tmp_path / "b.log.gz").read_bytes()
    assert gzip.decompress(packed) == (tmp_path / "a.log").read_bytes()


@pytest.mark.parametrize(
    ("field", "change", "message"),
    [
        ("odometry", lambda o: o[:, :2], r"odometry: shape \(40, 2\) is not \(40, 3\)"),
        ("stamps", lambda s: s[1:], r"stamps: shape \(39,\) is not \(40,\)"),
        ("stamps", lambda s: changed(s, 7, np.inf), r"stamps\[7\]: inf is not finite"),
        ("odometry", lambda o: changed(o, (3, 1), np.nan), r"odometry\[3, 1\]: nan is not finite"),
        ("scans", lambda s: ranges_of(s, s.ranges[0]), r"shape \(\d+,\) are not \(N, slots\)"),
        (
            "scans",
            lambda s: limited(s, 2, 20.0),
            r"range_max\[2\]: 20.0 m is not that of the first",
        ),
        ("scans", lambda s: limited(s, slice(None), 90.0), r"range_max\[0\]: 90.0 m .* to 81.82"),
        ("scans", lambda s: limited(s, slice(None), 0.5), r"range_max\[0\]: 0.5 m .* from 1.0"),
    ],
)
def test_what_cannot_be_written_is_named_and_the_old_file_stays(
    tmp_path, run, field, change, message
):
    (tmp_path / "run.log").write_text("old")
    with pytest.raises(ValueError, match=message):
        write_log(tmp_path / "run.log", **run | {field: change(run[field])})
    assert [path.name for path in tmp_path.iterdir()] == ["run.log"]
    assert (tmp_path / "run.log").read_text() == "old"


def changed(array, index, value):
    array = np.array(array)
    array[index] = value
    return array


def ranges_of(scans, ranges):
    return eqx.tree_at(lambda s: s.ranges, scans, ranges)


def limited(scans, which, metres):
    return eqx.tree_at(lambda s: s.range_max, scans, changed(scans.range_max, which, metres))
