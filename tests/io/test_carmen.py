import gzip
import math
from itertools import pairwise

import numpy as np
import pytest

from aprjax.io.files import MOST_BEAMS
from aprjax.io.log import LogError
from aprjax.io.logs import read_log
from aprjax.io.messages import LASERS
from tests.make_logs import write_logs

RAMP = [1.0 + 0.01 * i for i in range(180)]


def old(ranges=RAMP, kind="FLASER", pose="1 2 0.5", odom="7 8 0.9", stamp="3.5"):
    body = " ".join(map(str, ranges))
    return f"{kind} {len(ranges)} {body} {pose} {odom} {stamp} host 4.5"


def header(ranges, kind, start=-1.5, resolution=0.0175, maximum=50.0, remissions=()):
    body = " ".join(map(str, [len(ranges), *ranges, len(remissions), *remissions]))
    return f"{kind} 0 {start} 99 {resolution} {maximum} 0.01 0 {body}"


def raw(ranges=RAMP, kind="RAWLASER1", **fields):
    return f"{header(ranges, kind, **fields)} 3.5 host 4.5"


def robot(ranges=RAMP, kind="ROBOTLASER1", pose="1 2 0.5", robot_pose="7 8 0.9", **fields):
    return f"{header(ranges, kind, **fields)} {pose} {robot_pose} 0.1 0.2 0.3 0.4 0.5 3.5 host 4.5"


def odom(x, y, theta):
    return f"ODOM {x} {y} {theta} 0 0 0 1.5 host 1.5"


def param(name, value):
    return f"PARAM {name} {value} 0.0 nohost 0"


@pytest.fixture
def write(tmp_path):
    """Writes lines or bytes to a file and returns its path."""

    def write(*lines, data=None, name="run.log"):
        path = tmp_path / name
        path.write_bytes("\n".join((*lines, "")).encode() if data is None else data)
        return path

    return write


def only(path, **options):
    (entry,) = read_log(path, **options)
    return entry


def odometry(log):
    poses = [entry.odometry for entry in log if entry.odometry is not None]
    assert len(poses) == log.report.scans
    return np.array(poses)


# Messages


@pytest.mark.parametrize("kind", ["FLASER", "RLASER", "LASER3", "LASER4"])
def test_old_laser_lines(write, kind):
    entry = only(write(old(kind=kind)))
    assert (entry.laser, entry.line, entry.stamp, entry.odometry) == (kind, 1, 3.5, None)
    np.testing.assert_allclose(entry.scan.ranges, RAMP, rtol=1e-6)
    np.testing.assert_array_equal(entry.logged_pose, [1, 2, 0.5])
    assert (entry.scan.range_min, entry.scan.range_max) == (np.float32(0.02), 80)


@pytest.mark.parametrize("kind", ["RAWLASER1", "RAWLASER2", "RAWLASER3", "RAWLASER4"])
def test_raw_laser_lines_have_no_pose(write, kind):
    entry = only(write(raw(kind=kind, remissions=(7, 8, 9), maximum=30)))
    assert (entry.laser, entry.stamp, entry.scan.beams, entry.scan.range_max) == (
        kind,
        3.5,
        180,
        30,
    )
    assert entry.odometry is None
    assert entry.logged_pose is None


@pytest.mark.parametrize("kind", ["ROBOTLASER1", "ROBOTLASER2"])
@pytest.mark.parametrize("remissions", [(), (0.5, 0.25)])
def test_robot_laser_lines(write, kind, remissions):
    entry = only(write(robot(kind=kind, remissions=remissions)))
    assert (entry.laser, entry.stamp) == (kind, 3.5)
    np.testing.assert_allclose(entry.scan.ranges, RAMP, rtol=1e-6)
    np.testing.assert_array_equal(entry.logged_pose, [1, 2, 0.5])
    np.testing.assert_array_equal(entry.odometry, [7, 8, 0.9])


def test_angles_come_from_start_and_resolution_whatever_the_field_of_view(write):
    scan = only(write(robot([1, 2, 3], start=0.3, resolution=-0.01))).scan
    np.testing.assert_allclose([scan.angle_min, scan.angle_increment], [0.3, -0.01])


@pytest.mark.parametrize(
    ("beams", "params", "degrees"),
    [
        (180, (), 1),
        (181, (), 1),
        (360, (), 0.5),
        (361, (), 0.5),
        (721, (), 0.25),
        (90, (), 2),
        (1, (), 180),
        (1, [("laser_front_laser_resolution", 1e-309)], 180),
        (181, [("laser_front_laser_resolution", 0.5)], 0.5),
        (180, [("laser_frontlaser_resolution", 0.25)], 0.25),
        (361, [("laser_front_laser_resolution", 50)], 0.5),
        (361, [("laser_front_laser_resolution", 0)], 0.5),
        (361, [("laser_front_laser_resolution", "none")], 0.5),
        (361, [("laser_front_laser_resolution", "nan")], 0.5),
        (361, [("laser_rear_laser_resolution", 0.25)], 0.5),
    ],
)
def test_old_laser_angles(write, beams, params, degrees):
    path = write(*(param(*each) for each in params), old([1.5] * beams))
    scan = only(path, strict=True).scan
    assert scan.angle_min == np.float32(-math.pi / 2)
    np.testing.assert_allclose(np.degrees(scan.angle_increment), degrees, rtol=1e-6)


def test_a_param_is_for_its_own_laser(write):
    lines = [param(f"laser_{name}_resolution", 0.25) for name in ("rear_laser", "laser3")]
    for kind, degrees in (("RLASER", 0.25), ("LASER3", 0.25), ("LASER4", 1)):
        scan = only(write(*lines, old(kind=kind))).scan
        np.testing.assert_allclose(np.degrees(scan.angle_increment), degrees, rtol=1e-6)


def test_other_lines_are_counted_not_read(write):
    path = write(
        "# message formats defined: FLASER ODOM",
        "",
        "VERTEX2 0 1 2 3",
        old(),
        "NEFF 30",
        "NEFF 12.5 0 pippo 0",
        "SYNC tag 1 host 1",
        "TRUEPOS 1 2 3 1 2 3 1 host 1",
        "#LOOP EDGES",
        "EDGE2 0 1 0.1 0.2 0.3 1 0 1 1 0 0",
        "EDGE2 1 2 0.1 0.2 0.3 1 0 1 1 0 0",
        "PARAM robot_name",
    )
    report = read_log(path, strict=True).report
    assert (report.lines, report.scans, report.vertices, report.edges) == (12, 1, 1, 2)
    assert report.unknown == {"NEFF": 2}
    assert report.messages["TRUEPOS"] == report.messages["SYNC"] == report.messages["PARAM"] == 1


def test_one_of_two_messages_of_the_same_scans_is_taken(write):
    path = write(old(), robot(), old(), robot(), old(kind="RLASER"))
    log = read_log(path)
    assert [entry.line for entry in log] == [2, 4]
    assert (log.report.lasers, log.report.other_lasers) == (("ROBOTLASER1",), 3)


def test_lasers_are_taken_in_the_order_of_preference(write):
    makers = {"ROBOT": robot, "RAWLA": raw}
    for at, kind in enumerate(LASERS):
        lines = [makers.get(name[:5], old)(kind=name) for name in LASERS[at:][::-1]]
        assert read_log(write(*lines)).report.lasers == (kind,)


def test_chosen_lasers_come_in_the_order_of_the_file(write):
    path = write(old(), raw(), old(kind="RLASER"))
    log = read_log(path, lasers=("RLASER", "FLASER"))
    assert [entry.laser for entry in log] == ["FLASER", "RLASER"]
    assert log.report.other_lasers == 1


def test_a_log_is_read_again_by_every_iteration(write):
    log = read_log(write(odom(0, 0, 0), old(), odom(1, 0, 0), odom(2, 0, 0), old()))
    first, second = list(log), list(log)
    assert len(first) == len(second) == log.report.scans == 2
    np.testing.assert_array_equal(first[1].odometry, second[1].odometry)


# Damage


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (old().replace("FLASER 180", "FLASER 181"), "fields"),
        (old().replace("FLASER 180", "FLASER many"), "not a count"),
        (old().replace("FLASER 180", "FLASER -1"), "not a count"),
        (old().replace("FLASER 180", "FLASER " + "9" * 50), "not a count"),
        (old([]), "not a count"),
        ("FLASER", "fields"),
        (old()[:300], "fields"),
        (old(["x", *RAMP[1:]]), "not a number"),
        (old(pose="1 nan 0"), "not finite"),
        (old(stamp="later"), "not a number"),
        (robot(pose="inf 0 0"), "not finite"),
        (robot(robot_pose="0 0 nan"), "not finite"),
        (robot(resolution=0), "field of view"),
        (robot(resolution="nan"), "field of view"),
        (robot(resolution=0.1), "field of view"),
        (robot(resolution=6.2898 / 5), "field of view"),
        (raw(start=-90), "field of view"),
        (raw(start="left"), "not a number"),
        (raw() + " 0", "fields"),
        (odom(0, "nan", 0), "not finite"),
        ("ODOM 1 2 3", "fields"),
        ("VERTEX2 0 1 2", "fields"),
        ("EDGE2 0 1 0 x 0 1", "not a number"),
        ("FLASER " + "1 " * 600_000, "fields"),
    ],
)
def test_a_damaged_line_is_skipped_and_reported_or_raised_if_strict(write, line, reason):
    path = write(old(), line, "# comment", old())
    log = read_log(path, lasers=("FLASER",))
    assert [entry.line for entry in log] == [1, 4]
    ((number, why),) = log.report.damaged
    assert (number, log.report.damaged_lines) == (2, 1)
    assert reason in why
    with pytest.raises(LogError, match="line 2: ") as error:
        read_log(path, strict=True)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_the_list_of_damaged_lines_and_unknown_kinds_is_capped(write):
    report = read_log(write(old(), *(f"FLASER {i}\nNEW{i}" for i in range(500)))).report
    assert (len(report.damaged), report.damaged_lines) == (100, 500)
    assert len(report.unknown) == 101
    assert report.unknown.total() == 500


def test_bytes_that_are_no_text_do_not_matter(write):
    data = b"\xff\xfe\x00 junk\n" + old().encode() + b"\r\n" + b"caf\xe9 1 2\n"
    assert only(write(data=data)).line == 2


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "empty"),
        (gzip.compress(b"", mtime=0), "empty"),
        (b"# nothing\n\nNEFF 30\n", "not a CARMEN log"),
        (bytes(range(256)) * 50, "not a CARMEN log"),
        (b"\x00" * 5_000_000, "not a CARMEN log"),
        (b"FLASER 3 1 2\n", "no intact scan, 1 damaged lines; line 1: "),
    ],
)
def test_a_file_without_a_scan_is_refused_in_one_line(write, data, reason):
    path = write(data=data)
    with pytest.raises(LogError, match=reason) as error:
        read_log(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_a_missing_file_and_a_folder_are_log_errors(tmp_path):
    for path in (tmp_path / "none.log", tmp_path):
        with pytest.raises(LogError, match=str(path)):
            read_log(path)


def test_lasers_that_are_not_there(write):
    path = write(old())
    with pytest.raises(LogError, match="no scan of RLASER, only of FLASER"):
        read_log(path, lasers=["RLASER"])
    with pytest.raises(ValueError, match="'SONAR' is none of"):
        read_log(path, lasers=["SONAR"])


def test_gzip_is_known_by_its_bytes_not_by_its_name(write):
    data = old().encode()
    assert only(write(data=gzip.compress(data), name="run.log")).line == 1
    assert only(write(data=data, name="run.log.gz")).line == 1


@pytest.mark.parametrize(
    ("damage", "reason", "strict"),
    [
        ("cut", "cut off", False),
        ("cut", "cut off", True),
        ("tail", "cut off", False),
        ("crc", "corrupt", False),
        ("bits", "corrupt", False),
    ],
)
def test_damaged_gzip_data_is_refused_by_the_first_pass(write, damage, reason, strict):
    rng = np.random.default_rng(0)
    data = gzip.compress(
        "\n".join(old(rng.uniform(1, 9, 180).round(4)) for _ in range(300)).encode()
    )
    half = len(data) // 2
    path = write(
        data={
            "cut": data[:half],
            "tail": data[:-3],
            "crc": data[:-8] + bytes(8),
            "bits": data[:half] + bytes(200) + data[half + 200 :],
        }[damage]
    )
    with pytest.raises(LogError, match=reason) as error:
        read_log(path, strict=strict)
    assert "\n" not in str(error.value)


def test_gzip_data_that_unpack_to_far_more_than_their_size_are_refused(write):
    path = write(data=gzip.compress(b"#" + bytes(65 << 20)))
    with pytest.raises(LogError, match=f"unpacks to over {1 << 26} bytes, too many for its "):
        read_log(path)


def test_a_scan_of_more_readings_than_any_scanner_has_is_damaged(write):
    path = write(old(), old([1] * (MOST_BEAMS + 1)), raw([1] * (MOST_BEAMS + 1)), old())
    report = read_log(path, lasers=["FLASER"]).report
    assert (report.scans, report.damaged_lines) == (2, 2)
    assert report.damaged[0] == (2, f"{MOST_BEAMS + 1} readings are more than {MOST_BEAMS}")


def test_a_file_that_changes_is_a_log_error_of_the_iteration(write):
    log = read_log(write(old(), old()))
    write(old())
    with pytest.raises(LogError, match=r"run\.log: changed: 1 scans where the survey found 2"):
        list(log)


def test_a_file_that_goes_away_is_a_log_error_of_the_iteration(write):
    path = write(old())
    log = read_log(path)
    path.unlink()
    with pytest.raises(LogError, match="No such file"):
        list(log)


# Ranges


def test_codes_and_impossible_readings(write):
    codes = [81.83, 81.87, 81.89, 81.90, 81.91, 8191, 0, -1, "nan", "-inf", "inf", 79.34]
    ranges = only(write(old([*codes, *RAMP]))).scan.ranges[: len(codes)]
    np.testing.assert_array_equal(np.isposinf(ranges), [1] + [0] * 9 + [1, 0])
    np.testing.assert_array_equal(np.isnan(ranges), [0] + [1] * 9 + [0, 0])


@pytest.mark.parametrize("maximum", [8.0, 20.0, 31.99, 50.0])
def test_a_reading_at_the_headers_maximum_is_no_return_and_beyond_is_invalid(write, maximum):
    readings = [maximum - 0.01, maximum, maximum + 0.01]
    lines = [robot(maximum=maximum)] * 10
    *_, entry = read_log(write(*lines, robot([*readings, *RAMP], maximum=maximum)))
    assert entry.scan.range_max == np.float32(maximum)
    hit, free, invalid = entry.scan.ranges[:3]
    assert hit == np.float32(readings[0])
    assert free == np.inf
    assert invalid > entry.scan.range_max or np.isnan(invalid)


def test_an_old_laser_takes_its_maximum_from_a_param(write):
    line = param("robot_front_laser_max", 50)
    assert only(write(line, old())).scan.range_max == 50
    assert only(write(line, old(kind="RLASER"))).scan.range_max == 80


@pytest.mark.parametrize("maximum", [0, -1, 0.5, 81.83, 8191, "nan", "inf", 2.0])
def test_a_maximum_that_is_none_or_that_many_readings_exceed_is_ignored(write, maximum):
    scan = only(write(robot(maximum=maximum))).scan
    assert scan.range_max == 80
    np.testing.assert_allclose(scan.ranges, RAMP, rtol=1e-6)


# Saturation


def readings(rng, scans=60, beams=180):
    """Centimetre readings that thin out with length, as a building's do: up to some 50 m."""
    return rng.exponential(6.0, (scans, beams)).clip(0.3).round(2)


def saturation(write, ranges, **fields):
    return read_log(write(*(raw(row, **fields) for row in ranges))).report.saturation


@pytest.mark.parametrize("value", [8.0, 20.0, 31.99])
@pytest.mark.parametrize("maximum", [5.0, 50.0])
def test_a_value_that_all_longer_readings_have_is_saturation(write, value, maximum):
    ranges = readings(np.random.default_rng(0), scans=150).clip(max=value)
    log = read_log(write(*(raw(row, maximum=maximum) for row in ranges)))
    assert log.report.saturation == value
    for entry, logged in zip(log, ranges, strict=True):
        assert entry.scan.range_max == np.float32(value)
        np.testing.assert_array_equal(np.isposinf(entry.scan.ranges), logged == value)


def test_saturation_may_jitter_up_to_a_second_value(write):
    rng = np.random.default_rng(0)
    ranges = readings(rng).clip(max=20.0)
    ranges[(ranges == 20.0) & (rng.random(ranges.shape) < 0.08)] = 20.05
    log = read_log(write(*(raw(row) for row in ranges)))
    assert log.report.saturation == 20.0
    free = [np.isposinf(entry.scan.ranges) for entry in log]
    np.testing.assert_array_equal(free, ranges >= 20.0)


def test_isolated_far_readings_are_neither_saturation_nor_hide_it(write):
    rng = np.random.default_rng(0)
    ranges = readings(rng).clip(max=45)
    ranges[::10, 7] = [52.15, 52.19, 52.19, 52.2, 52.2, 79.3]
    assert saturation(write, ranges) is None
    ranges = ranges.clip(max=20)
    ranges[::10, 7] = 52.19
    assert saturation(write, ranges) == 20


@pytest.mark.parametrize("wall", [10.0, 10.005])
@pytest.mark.parametrize("noise", [0.005, 0.01, 0.02])
def test_a_wall_before_a_standing_robot_is_no_saturation(write, wall, noise):
    rng = np.random.default_rng(0)
    bearings = np.radians(np.arange(-90, 90))
    ahead = wall / np.cos(bearings).clip(1e-9)
    for half_width in (0.5, 3.0):
        aside = half_width / abs(np.sin(bearings)).clip(1e-9)
        ranges = np.minimum(ahead, aside) + rng.normal(0, noise, (100, 180))
        assert saturation(write, ranges.round(2)) is None


def test_a_room_seen_without_noise_from_one_place_has_no_saturation(write):
    assert saturation(write, [RAMP] * 50) is None


def test_a_log_of_one_constant_is_taken_as_it_stands(write):
    scan = only(write(raw([5.0] * 180))).scan
    np.testing.assert_array_equal(scan.ranges, np.full(180, 5.0))


def test_each_laser_has_its_own_saturation(write):
    rng = np.random.default_rng(0)
    front, rear = readings(rng).clip(max=20), readings(rng).clip(max=8)
    lines = [
        line
        for one, other in zip(front, rear, strict=True)
        for line in (old(one), old(other, kind="RLASER"))
    ]
    report = read_log(write(*lines), lasers=("FLASER", "RLASER")).report
    assert report.saturations == {"FLASER": 20.0, "RLASER": 8.0}


# Odometry


def test_steps_go_from_the_first_odom_after_a_scan_to_the_last_before_the_next(write):
    """The first ODOM after each scan restarts at a pose of its own, as in a corrected log."""
    log = read_log(
        write(
            odom(50, 60, 3),
            odom(51, 60, 3),
            old(pose="9 9 1", odom="9 9 1"),
            odom(100, 0, math.pi / 2),  # restart
            odom(100, 1, math.pi / 2),
            odom(100, 2, math.pi),  # 2 m ahead, 90° to the left
            old(pose="8 8 1", odom="8 8 1"),
            odom(-5, -5, 0),  # restart
            odom(-2, -4, 0),  # 3 m ahead, 1 m to the left
            old(pose="7 7 1", odom="7 7 1"),
            odom(0, 0, 0),
            old(),
            old(),
        )
    )
    expected = [[0, 0, 0], [2, 0, math.pi / 2], *[[1, 3, math.pi / 2]] * 3]
    np.testing.assert_allclose(odometry(log), expected, atol=1e-12)
    assert log.report.moved == 2


@pytest.mark.parametrize(("odoms", "scans"), [(50, 5), (20, 5), (10, 5), (10, 10), (7, 10)])
@pytest.mark.parametrize("stated", ["0 0 0", "odometry"])
def test_a_raw_log_keeps_the_motion_across_its_scans(write, odoms, scans, stated):
    """ODOM lines go on; lasers state the pose of the last one, or nothing."""
    moments = sorted(
        [(k / odoms, "odom") for k in range(10 * odoms)]
        + [(k / scans + 1e-3, "scan") for k in range(10 * scans)]
    )
    lines, truth, x = [], [], 0.0
    for stamp, kind in moments:
        if kind == "odom":
            x = 0.5 * stamp
            lines.append(odom(x, 0, 0))
        else:
            truth.append(x)
            pose = f"{x} 0 0" if stated == "odometry" else stated
            lines.append(old(pose=pose, odom=pose))
    log = read_log(write(*lines))
    np.testing.assert_allclose(odometry(log)[:, 0], np.array(truth) - truth[0], atol=1e-9)
    assert log.report.moved == sum(a != b for a, b in pairwise(truth))


def test_small_restarts_at_the_scans_own_pose_are_known_for_what_they_are(write):
    """Wheel odometry that is a tenth too long, in a corrected log."""
    lines = []
    for k in range(20):
        pose = f"{0.5 * k} 0 0"
        lines += [old(pose=pose, odom=pose), odom(0.5 * k, 0, 0), odom(0.5 * k + 0.55, 0, 0)]
    log = read_log(write(*lines))
    np.testing.assert_allclose(odometry(log)[:, 0], 0.55 * np.arange(20), atol=1e-9)


def test_robot_poses_are_taken_where_odom_lines_tell_of_no_step(write):
    log = read_log(write(odom(0, 0, 0), robot(), robot(robot_pose="8 8 0.9")))
    np.testing.assert_array_equal(odometry(log), [[7, 8, 0.9], [8, 8, 0.9]])


def test_headings_stay_within_half_a_turn(write):
    lines = [old()]
    for _ in range(3):
        lines += [odom(0, 0, 3.0), odom(0, 0, -3.0), odom(0, 0, -1.0), old()]
    headings = odometry(read_log(write(*lines)))[:, 2]
    turn = 2 * math.pi - 4
    expected = [0, turn, 2 * turn - 2 * math.pi, 3 * turn - 2 * math.pi]
    np.testing.assert_allclose(headings, expected, atol=1e-12)


@pytest.mark.parametrize("between", [old(pose="1 nan 0"), old(kind="RLASER"), "FLASER 180 1 2"])
def test_no_step_goes_across_another_lasers_scan_or_a_damaged_one(write, between):
    lines = [odom(1, 0, 0), between, odom(700, 0, 0), odom(702, 0, 0)]
    log = read_log(write(old(), odom(0, 0, 0), *lines, old()), lasers=["FLASER"])
    np.testing.assert_allclose(odometry(log)[1], [3, 0, 0], atol=1e-12)


def test_a_damaged_odom_line_is_left_out_of_its_step(write):
    log = read_log(write(old(), odom(0, 0, 0), odom(1, 0, 0), odom(5, "x", 0), old()))
    np.testing.assert_array_equal(odometry(log)[1], [1, 0, 0])


def test_odom_lines_are_preferred_to_robot_poses(write):
    log = read_log(write(robot(), odom(0, 0, 0), odom(1, 0, 0), robot()))
    np.testing.assert_array_equal(odometry(log), [[0, 0, 0], [1, 0, 0]])


# Whole logs


def test_the_simulated_logs_come_back_as_they_were_written(tmp_path):
    paths = write_logs(tmp_path / "a")
    again = write_logs(tmp_path / "b")
    for path, twin, scans in zip(paths, again, (8, 20), strict=True):
        assert path.read_bytes() == twin.read_bytes()
        log = read_log(path, strict=True)
        entries = list(log)
        assert len(entries) == log.report.scans == scans
        assert log.report.saturation is None
        assert [entry.stamp for entry in entries] == [0.5 * i for i in range(scans)]
        for entry in entries:
            scan = entry.scan
            assert (scan.beams, scan.range_max) == (181, 30)
            assert np.all((scan.ranges > scan.range_min) & (scan.ranges < scan.range_max))
            np.testing.assert_allclose(scan.angle_min, -np.pi / 2, atol=1e-6)
            np.testing.assert_allclose(scan.angle_increment, np.pi / 180, atol=1e-8)
            np.testing.assert_array_equal(entry.odometry, entry.logged_pose)
