import os
import shutil
import sys
import tracemalloc

import numpy as np
import pytest

import aprjax
from aprjax.io import bag_file
from aprjax.io.bag_file import bag_topics, is_bag
from aprjax.io.files import MOST_BEAMS
from aprjax.io.log import LogError
from tests.io.bags import STORAGES, Bag

RANGES = np.linspace(1.0, 5.0, 181)
LASER = "sensor_msgs/msg/LaserScan"


@pytest.fixture(params=STORAGES)
def bag(request) -> Bag:
    return Bag(request.param)


@pytest.fixture
def mcap() -> Bag:
    return Bag("mcap")


def drive(bag: Bag) -> Bag:
    """Three scans half a second apart, and odometry between them."""
    for number in range(3):
        bag.scan(RANGES + number, 10.0 + 0.5 * number)
    for number in range(4):
        bag.odometry([1.0 * number, 0.0, 0.1 * number], 9.75 + 0.5 * number)
    return bag


def test_scans_odometry_and_stamps_are_read_from_every_storage(bag, tmp_path):
    log = aprjax.read_log(drive(bag).write(tmp_path))
    entries = list(log)
    assert len(entries) == log.report.scans == 3
    for number, entry in enumerate(entries):
        np.testing.assert_array_equal(entry.scan.ranges, np.float32(RANGES + number))
        assert entry.scan.angle_min == np.float32(-np.pi / 2)
        assert entry.scan.angle_increment == np.float32(np.pi / 180)
        assert (entry.scan.range_min, entry.scan.range_max) == (np.float32(0.1), 30.0)
        assert entry.stamp == pytest.approx(10.0 + 0.5 * number, abs=1e-6)
        # Half way between two messages of odometry.
        np.testing.assert_allclose(
            entry.odometry, [number + 0.5, 0.0, 0.1 * number + 0.05], atol=1e-6
        )
        assert (entry.laser, entry.line, entry.logged_pose) == ("/scan", number + 1, None)
    again = [entry.stamp for entry in log]
    assert again == [entry.stamp for entry in entries]
    report = log.report
    assert (report.kind, report.lasers, report.odometry) == ("ROS bag", ("/scan",), "/odom")
    assert (report.lines, report.damaged_lines) == (7, 0)


def test_topics_are_listed(bag, tmp_path):
    path = drive(bag).write(tmp_path)
    topics = [(topic.name, topic.kind, topic.messages) for topic in bag_topics(path)]
    assert topics == [("/odom", "nav_msgs/msg/Odometry", 4), ("/scan", LASER, 3)]


def test_the_first_echo_counts_and_no_echo_says_nothing(bag, tmp_path):
    echoes = [[1.5, 3.0], [], [np.inf], [2.0]]
    (entry,) = aprjax.read_log(bag.scan(None, echoes=echoes).write(tmp_path))
    np.testing.assert_array_equal(entry.scan.ranges, np.float32([1.5, np.nan, np.inf, 2.0]))


def test_ranges_are_as_rep_117_has_them(mcap, tmp_path):
    ranges = [1.0, np.inf, -np.inf, np.nan, 0.0, 0.05, 30.0, 31.0]
    (entry,) = aprjax.read_log(mcap.scan(ranges).write(tmp_path))
    assert np.asarray(entry.scan.hit).tolist() == [True, *[False] * 5, True, False]
    assert np.asarray(entry.scan.no_return).tolist() == [False, True, *[False] * 6]


def test_a_saturation_value_is_no_return(mcap, tmp_path):
    for number in range(10):
        mcap.scan([*np.linspace(1, 4, 50) + 0.01 * number, 25.0, 25.0, 25.0], 1.0 + number)
    for entry in aprjax.read_log(mcap.write(tmp_path)):
        assert np.isposinf(np.asarray(entry.scan.ranges)[-3:]).all()
        assert entry.scan.range_max == 25.0


def test_the_laser_is_where_the_transforms_say(bag, tmp_path):
    bag.transform("base_link", "mast", [0.2, 0.0, np.pi / 2])
    bag.transform("mast", "laser", [0.1, 0.0, -np.pi / 2])
    bag.odometry([0, 0, 0], 0.9).odometry([0, 0, np.pi / 2], 1.0).scan(RANGES, 1.0)
    log = aprjax.read_log(bag.write(tmp_path))
    np.testing.assert_allclose(log.report.T_robot_laser["/scan"], [0.2, 0.1, 0.0], atol=1e-9)
    (entry,) = log
    np.testing.assert_allclose(entry.odometry, [-0.1, 0.2, np.pi / 2], atol=1e-9)


def test_frames_with_a_slash_and_a_chain_above_the_robot(bag, tmp_path):
    bag.transform("/base_footprint", "/base_link", [0.0, 0.0, 0.0])
    bag.transform("/base_link", "/laser", [0.3, 0.0, 0.0])
    bag.transform("/odom", "/base_footprint", [5.0, 5.0, 1.0], static=False)
    bag.odometry([0, 0, 0], child="/base_footprint").scan(RANGES, frame="/laser")
    log = aprjax.read_log(bag.write(tmp_path))
    np.testing.assert_allclose(log.report.T_robot_laser["/scan"], [0.3, 0, 0], atol=1e-9)
    assert log.report.odometry == "/odom"


def test_without_a_topic_the_frame_odom_is_the_odometry(bag, tmp_path):
    bag.transform("base_link", "laser", [0.5, 0.0, 0.0])
    for number in range(3):
        bag.transform("odom", "base_link", [number, 0, 0], 1.0 + number, static=False)
        bag.transform("map", "odom", [7, 7, 1], 1.0 + number, static=False)
    bag.scan(RANGES, 1.5).scan(RANGES, 2.5)
    log = aprjax.read_log(bag.write(tmp_path))
    assert log.report.odometry == "/tf"
    odometry = np.array([entry.odometry for entry in log])
    np.testing.assert_allclose(odometry, [[1.0, 0, 0], [2.0, 0, 0]], atol=1e-6)


def test_without_odometry_a_moving_frame_is_not_the_mounting(mcap, tmp_path):
    mcap.transform("robot", "laser", [0.5, 0.0, 0.0])
    mcap.transform("map", "robot", [9, 9, 2], static=False).scan(RANGES)
    log = aprjax.read_log(mcap.write(tmp_path))
    np.testing.assert_allclose(log.report.T_robot_laser["/scan"], [0.5, 0, 0], atol=1e-9)
    assert [entry.odometry for entry in log] == [None]


def test_a_laser_that_hangs_upside_down_counts_clockwise(bag, tmp_path):
    bag.transform("base_link", "laser", [0.0, 0.0, np.pi / 2], flipped=True)
    (entry,) = aprjax.read_log(bag.odometry([0, 0, 0]).scan(RANGES).write(tmp_path))
    np.testing.assert_allclose(entry.odometry, [0, 0, np.pi / 2], atol=1e-9)
    # Its beam 0 looks to its right; hanging, that is the robot's left of where it points.
    assert entry.scan.angle_min == np.float32(np.pi / 2)
    assert entry.scan.angle_increment == np.float32(-np.pi / 180)


def test_a_base_that_no_transforms_join_with_the_laser_does_not_hide_one_that_they_do(
    bag, tmp_path
):
    bag.transform("odom", "base_footprint", [0, 0, 0], static=False)
    bag.transform("base_link", "laser", [0.3, 0.0, 0.0], flipped=True)
    bag.odometry([0, 0, 0], child="base_footprint").scan(RANGES)
    log = aprjax.read_log(bag.write(tmp_path))
    np.testing.assert_allclose(log.report.T_robot_laser["/scan"], [0.3, 0, 0], atol=1e-9)
    (entry,) = log
    assert entry.scan.angle_increment < 0


def test_a_tilted_laser_is_refused(mcap, tmp_path):
    tilted = (0.0, np.sin(0.4), 0.0, np.cos(0.4))
    mcap.transform("base_link", "laser", [0, 0, 0], rotation=tilted)
    with pytest.raises(LogError, match="'laser' is tilted by 46° in 'base_link'"):
        aprjax.read_log(mcap.scan(RANGES).write(tmp_path))


def test_scans_outside_the_odometry_get_its_ends(mcap, tmp_path):
    mcap.odometry([1, 0, 0], 5.0).odometry([2, 0, 0], 6.0)
    entries = aprjax.read_log(mcap.scan(RANGES, 1.0).scan(RANGES, 9.0).write(tmp_path))
    assert [entry.odometry[0] for entry in entries] == [1.0, 2.0]


def test_headings_are_interpolated_the_short_way_round(mcap, tmp_path):
    mcap.odometry([0, 0, 3.1], 1.0).odometry([0, 0, -3.1], 2.0).scan(RANGES, 1.5)
    (entry,) = aprjax.read_log(mcap.write(tmp_path))
    assert abs(entry.odometry[2]) == pytest.approx(np.pi, abs=1e-6)


def test_one_of_several_topics_has_to_be_chosen(bag, tmp_path):
    bag.scan(RANGES, 1.0, "/front").scan(RANGES + 1, 2.0, "/back").scan(RANGES + 2, 3.0, "/back")
    path = bag.odometry([0, 0, 0]).odometry([1, 0, 0], topic="/wheels").write(tmp_path)
    lasers = r"choose one: /back \(2\), /front \(1\)"
    with pytest.raises(LogError, match=lasers):
        aprjax.read_log(path)
    with pytest.raises(LogError, match=r"choose one: /odom \(1\), /wheels \(1\)"):
        aprjax.read_log(path, lasers=["/back"])
    log = aprjax.read_log(path, lasers=["/back"], odometry="/wheels")
    assert [entry.odometry[0] for entry in log] == [1.0, 1.0]
    assert log.report.other_lasers == 1
    log = aprjax.read_log(path, lasers=["/front", "/back"], odometry=False)
    assert [(entry.laser, entry.line, entry.odometry) for entry in log] == [
        ("/front", 1, None), ("/back", 1, None), ("/back", 2, None)
    ]  # fmt: skip
    with pytest.raises(LogError, match=r"'/none' is no topic of laser scans; there are /back"):
        aprjax.read_log(path, lasers=["/none"])
    with pytest.raises(LogError, match=r"'/none' is no topic of odometry; there are /odom"):
        aprjax.read_log(path, lasers=["/back"], odometry="/none")
    with pytest.raises(LogError, match="no odometry in /tf"):
        aprjax.read_log(path, lasers=["/back"], odometry="/tf")


def test_a_bag_without_scans_names_what_it_holds(mcap, tmp_path):
    path = mcap.odometry([0, 0, 0]).write(tmp_path)
    with pytest.raises(LogError, match=r"no topic of laser scans, only /odom \(nav_msgs"):
        aprjax.read_log(path)


def test_damaged_messages_are_skipped_and_counted(bag, tmp_path):
    bag.scan(RANGES, 1.0).add("/scan", LASER, 2.0, b"\x00\x01\x00\x00abc")
    bag.scan(RANGES, 3.0, angle_increment=0.0, frame="other").scan(RANGES, 4.0)
    path = bag.odometry([0, np.nan, 0], 1.0).odometry([0, 1, 0], 2.0).write(tmp_path)
    log = aprjax.read_log(path)
    assert [entry.line for entry in log] == [1, 4]
    assert log.report.damaged_lines == 3
    assert {number for number, _ in log.report.damaged} == {1, 2, 3}
    assert any("angle_increment" in reason for _, reason in log.report.damaged)
    with pytest.raises(LogError, match=r"message 1: /odom: a pose is not finite"):
        aprjax.read_log(path, strict=True)


def test_no_intact_scan_is_said_with_the_reason(mcap, tmp_path):
    path = mcap.scan(RANGES, range_max=-1.0).write(tmp_path)
    with pytest.raises(LogError, match="no intact scan in /scan; message 1: /scan: range_min"):
        aprjax.read_log(path)


def test_a_file_of_a_bag_stands_for_it(tmp_path):
    for storage, pattern in (("sqlite3", "*.db3"), ("mcap", "*.mcap")):
        path = drive(Bag(storage)).write(tmp_path, storage)
        (file,) = path.glob(pattern)
        assert is_bag(file)
        assert len(list(aprjax.read_log(file))) == 3


def test_damaged_bags_are_refused_in_one_line(bag, tmp_path):
    path = drive(bag).write(tmp_path)
    files = (
        [path] if path.is_file() else [file for file in path.iterdir() if file.suffix != ".yaml"]
    )
    (file,) = files
    data = file.read_bytes()
    for kept in (20, len(data) // 3, len(data) - 10):
        file.write_bytes(data[:kept])
        try:
            list(aprjax.read_log(path))
        except LogError as error:
            assert str(error).startswith(f"{path}: ")
            assert "\n" not in str(error)


def test_chunks_packed_by_bzip2_are_read(tmp_path):
    path = drive(Bag("ros1")).write(tmp_path, bzip2=True)
    assert len(list(aprjax.read_log(path))) == 3
    data = path.read_bytes()
    at = data.index(b"BZh") + 100
    path.write_bytes(data[:at] + bytes(20) + data[at + 20 :])
    with pytest.raises(LogError, match="cut off or damaged after 0 messages"):
        aprjax.read_log(path)


def test_a_chunk_of_ros_1_is_unpacked_only_so_far(tmp_path):
    bag = drive(Bag("ros1")).add("/scan", LASER, 20.0, bytes(66 << 20))
    path = bag.write(tmp_path, bzip2=True)
    assert path.stat().st_size < 1 << 20
    tracemalloc.start()
    with pytest.raises(LogError, match=r"a chunk of \d+ bytes is cut off, or holds over 67108864"):
        aprjax.read_log(path)
    assert tracemalloc.get_traced_memory()[1] < 3 << 26
    tracemalloc.stop()


def test_a_chunk_of_mcap_that_claims_too_much_is_refused(mcap, tmp_path, monkeypatch):
    path = drive(mcap).write(tmp_path)
    monkeypatch.setattr(bag_file, "most_unpacked", lambda size: size - 1)
    for read in (path, next(path.glob("*.mcap"))):
        with pytest.raises(LogError, match=r"a chunk claims to hold \d+ bytes, too many for its"):
            aprjax.read_log(read)


def test_a_scan_of_more_readings_than_any_scanner_has_is_damaged(mcap, tmp_path):
    path = mcap.scan(np.ones(MOST_BEAMS + 1), angle_increment=1e-6).scan(RANGES).write(tmp_path)
    report = aprjax.read_log(path).report
    assert (report.scans, report.damaged_lines) == (1, 1)
    assert "65537 readings are more than 65536" in report.damaged[0][1]


def test_a_pipe_in_a_folder_is_not_waited_for(mcap, tmp_path):
    path = drive(mcap).write(tmp_path)
    (file,) = path.glob("*.mcap")
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(LogError, match="drive: a pipe or device is not read"):
        aprjax.read_log(path)


def test_what_is_no_bag_is_refused(bag, tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(LogError, match=r"folder: a folder without metadata.yaml.*ROS 2$"):
        aprjax.read_log(tmp_path / "folder")
    path = drive(bag).write(tmp_path)
    file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix != ".yaml")
    other = shutil.copy(file, tmp_path / "renamed.log")
    with pytest.raises(LogError, match=f"its name does not end in {file.suffix}"):
        aprjax.read_log(other)


def test_a_bag_whose_recording_was_cut_off_says_what_mends_it(bag, tmp_path):
    path = drive(bag).write(tmp_path)
    tool = {"ros1": "rosbag reindex", "sqlite3": "ros2 bag reindex", "mcap": "mcap recover"}
    file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix != ".yaml")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(LogError, match=f"if its recording was cut off, `{tool[bag.storage]}`"):
        list(aprjax.read_log(path))


def test_a_bag_that_is_still_being_recorded_says_what_mends_it(tmp_path):
    path = drive(Bag("ros1")).write(tmp_path)
    with pytest.raises(LogError, match=r"does not end in .bag \(if .* `rosbag reindex` mends it"):
        aprjax.read_log(path.rename(tmp_path / "drive.bag.active"))


def test_of_a_folder_of_bags_each_is_named(tmp_path):
    for name in ("a", "b"):
        drive(Bag("ros1")).write(tmp_path, name)
    with pytest.raises(LogError, match=r"; it holds a.bag, b.bag: read one at a time"):
        aprjax.read_log(tmp_path)


def test_a_compressed_file_is_told_from_a_log(tmp_path):
    path = tmp_path / "drive.mcap.zstd"
    path.write_bytes(b"\x28\xb5\x2f\xfd" + bytes(100))
    with pytest.raises(LogError, match="compressed by zstd"):
        aprjax.read_log(path)


def test_carmen_logs_are_no_bags(tmp_path):
    path = tmp_path / "a.log"
    path.write_text("FLASER 1 1 0 0 0 0 0 0 0 h 0\n")
    assert not is_bag(path)
    assert len(list(aprjax.read_log(path))) == 1
    with pytest.raises(LogError, match="not a bag, so there is no topic /odom"):
        aprjax.read_log(path, odometry="/odom")


def test_the_missing_extra_is_a_clear_line(mcap, tmp_path, monkeypatch):
    path = drive(mcap).write(tmp_path)
    for name in [name for name in sys.modules if name.startswith("rosbags")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(LogError, match=r"pip install 'aprjax\[rosbag\]'"):
        aprjax.read_log(path)
