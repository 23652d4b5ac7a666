"""ROS bags without ROS, by the `rosbags` package: ROS 1, and ROS 2 in SQLite and MCAP files.

As with CARMEN logs, a first pass surveys the bag, and every iteration streams its scans again.
"""

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aprjax.io.bag_file import Topic, messages_of, opened, topics_of
from aprjax.io.files import MOST_BEAMS
from aprjax.io.log import LISTED, Log, LogEntry, LogError, LogReport
from aprjax.io.ranging import BINS, in_millimetres, saturation_value
from aprjax.io.transforms import TransformTree, planar, pose_matrix
from aprjax.scan import Scan

LASER_SCAN = "sensor_msgs/msg/LaserScan"
MULTI_ECHO = "sensor_msgs/msg/MultiEchoLaserScan"
LASER_TYPES = (LASER_SCAN, MULTI_ECHO)
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
_OLD_TRANSFORMS = "tf/msg/tfMessage"
_TF = "/tf"
_TILT = math.radians(20.0)  # of a scanner's axis, beyond which its scans lie in no plane of the map
_BASES = ("base_footprint", "base_link")


def read_bag(
    path: str | os.PathLike[str],
    *,
    lasers: Sequence[str] | None = None,
    odometry: str | Literal[False] | None = None,
    strict: bool = False,
) -> "BagLog":
    """Survey a bag and return it ready to be iterated.

    `lasers` are the topics of scans to take, by default the only one: `LaserScan`s, and
    `MultiEchoLaserScan`s, of which the first echo counts. `odometry` is a topic of
    `nav_msgs/Odometry`, or `/tf` for the transforms below a frame `odom`; by default the only
    topic of that type, else `/tf` if it has such a frame, else none. False takes none.

    The static transforms and the first one of every other pair of frames say how a laser is
    mounted on the robot: in the first of these frames that they join with the laser's, the
    odometry's `child_frame_id`, base_footprint, base_link, and the highest one above the laser's
    that it does not move in. An entry's `odometry` is the pose of the laser, interpolated at the
    scan's stamp and held at either end; beams of a laser that hangs upside down are turned over.
    Where there is no transform, the laser is taken to be at the robot's centre. Ranges are as REP
    117 has them; a scanner's saturation value, see `saturation_value`, is no return.

    Damaged messages are skipped and counted, unless `strict`. Raises `LogError`, one line, for
    the missing extra, a bag that cannot be read, a topic that is not there, is of another type or
    has to be chosen, no intact scan, and a laser that is tilted. A scan of over 2¹⁶ readings is
    damaged, and a chunk refused that holds (in MCAP: claims to hold) over 64 MiB and over 100
    times its packed size. Of what zstd packed in a bag of ROS 2, `rosbags` finds a false claim,
    or none, only when it is unpacked: such a bag made to do harm can take any memory.
    """
    path = Path(path)
    with opened(path) as reader:
        topics = topics_of(reader)
        chosen = _choose_lasers(path, topics, lasers)
        source = _choose_odometry(path, topics, odometry)
        survey = _survey(path, reader, chosen, source, strict)
    report = survey.report
    if not report.scans:
        reason = (
            f"; message {report.damaged[0][0]}: {report.damaged[0][1]}" if report.damaged else ""
        )
        raise LogError(f"{path}: no intact scan in {', '.join(chosen)}{reason}")
    return _finish(path, survey, source, odometry)


class BagLog(Log):
    """A ROS bag."""

    def __init__(
        self,
        path: Path,
        report: LogReport,
        odometry: tuple[np.ndarray, np.ndarray] | None,
        mounts: dict[str, "_Mount"],
    ) -> None:
        """`odometry` are stamps `(N,)`, ascending, and poses of the robot `(N, 3)`."""
        super().__init__(path, report)
        self._odometry = odometry
        self._mounts = mounts

    def __iter__(self) -> Iterator[LogEntry]:
        with opened(self.path) as reader:
            numbers = dict.fromkeys(self.report.lasers, 0)
            found = 0
            for topic, time, read in messages_of(self.path, reader, self.report.lasers):
                numbers[topic] += 1
                try:
                    reading = _reading(read(), time)
                    mount = self._mounts.get(reading.frame, _CENTRE)
                    scan = reading.scan(self.report.saturations.get(topic), mount.upside_down)
                except (ValueError, AttributeError):
                    continue
                found += 1
                yield LogEntry(
                    scan=scan,
                    odometry=self._pose(reading.stamp, mount),
                    stamp=reading.stamp,
                    laser=topic,
                    logged_pose=None,
                    line=numbers[topic],
                )
        if found != self.report.scans:
            raise LogError(
                f"{self.path}: damaged: {found} scans where the survey found {self.report.scans}"
            )

    def _pose(self, stamp: float, mount: "_Mount") -> np.ndarray | None:
        if self._odometry is None:
            return None
        stamps, poses = self._odometry
        x, y, theta = (np.interp(stamp, stamps, column) for column in poses.T)
        cos, sin = math.cos(theta), math.sin(theta)
        ahead, left, turn = mount.T_robot_laser
        return np.array(
            [
                x + cos * ahead - sin * left,
                y + sin * ahead + cos * left,
                math.remainder(theta + turn, math.tau),
            ]
        )


@dataclass(frozen=True, eq=False)
class _Mount:
    """How a laser sits on the robot."""

    T_robot_laser: np.ndarray
    upside_down: bool = False
    known: bool = True


_CENTRE = _Mount(np.zeros(3), known=False)


@dataclass(frozen=True, eq=False)
class _Reading:
    """A message of a scan."""

    stamp: float
    frame: str
    ranges: np.ndarray
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float

    def scan(self, saturation: float | None = None, upside_down: bool = False) -> Scan:
        """Raises `ValueError` for what no scan can be."""
        ranges, range_max = self.ranges, self.range_max
        if saturation is not None:
            # As float32, a reading may be the last bit longer.
            ranges = np.where(ranges > saturation - 0.001, np.inf, ranges)
            range_max = min(range_max, saturation)
        turn = -1.0 if upside_down else 1.0
        return Scan.make(
            ranges,
            angle_min=turn * self.angle_min,
            angle_increment=turn * self.angle_increment,
            range_min=self.range_min,
            range_max=range_max,
        )


@dataclass(eq=False)
class _Survey:
    """What the first pass over a bag found."""

    report: LogReport
    readings: dict[str, np.ndarray]
    """Of each laser topic, how often each whole millimetre was read."""
    frames: set[tuple[str, str]] = field(default_factory=set)
    """Topics of scans, each with a frame that some are in."""
    odometry: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Stamp, x, y, theta."""
    robot: str = ""
    """The frame that the odometry is of, empty where not known."""
    transforms: TransformTree = field(default_factory=TransformTree)


def _survey(
    path: Path, reader: Any, lasers: tuple[str, ...], source: str | None, strict: bool
) -> _Survey:
    report = LogReport(kind="ROS bag", unit="message", lasers=lasers)
    survey = _Survey(report, {topic: np.zeros(BINS, np.int64) for topic in lasers})
    topics = topics_of(reader)
    report.lines = sum(topic.messages for topic in topics)
    report.messages.update({topic.name: topic.messages for topic in topics})
    report.other_lasers = sum(
        topic.messages for topic in topics if _is_laser(topic) and topic.name not in lasers
    )
    transforms = [topic.name for topic in topics if topic.kind in (TRANSFORMS, _OLD_TRANSFORMS)]
    wanted = {*lasers, *transforms, *([source] if source else [])}
    numbers = dict.fromkeys(wanted, 0)
    moved = 0
    for topic, time, read in messages_of(path, reader, tuple(wanted)):
        numbers[topic] += 1
        try:
            message = read()
            if topic in lasers:
                reading = _reading(message, time)
                reading.scan()
                survey.readings[topic] += in_millimetres(reading.ranges)
                survey.frames.add((topic, reading.frame))
                report.moved += moved >= 2 and report.scans > 0
                report.scans += 1
                moved = 0
            elif topic in transforms:
                for each in message.transforms:
                    survey.transforms.add(
                        _plain(each.header.frame_id),
                        _plain(each.child_frame_id),
                        _stamp(each.header, time),
                        _matrix(each.transform.translation, each.transform.rotation),
                        static=topic.endswith("_static"),
                    )
            else:
                pose = message.pose.pose
                x, y, theta = planar(_matrix(pose.position, pose.orientation))
                survey.odometry.append((_stamp(message.header, time), x, y, theta))
                survey.robot = survey.robot or _plain(message.child_frame_id)
                moved += 1
        except (ValueError, AttributeError) as error:
            reason = f"{topic}: {str(error).splitlines()[0] if str(error) else 'damaged'}"
            if strict:
                raise LogError(f"{path}: message {numbers[topic]}: {reason}") from None
            report.damaged_lines += 1
            if len(report.damaged) < LISTED:
                report.damaged.append((numbers[topic], reason))
    return survey


def _finish(
    path: Path, survey: _Survey, source: str | None, odometry: str | Literal[False] | None
) -> BagLog:
    """The log that a survey leads to."""
    report = survey.report
    for topic, counts in survey.readings.items():
        saturation = saturation_value(counts)
        if saturation is not None:
            report.saturations[topic] = saturation
    robot, rows = survey.robot, np.array(survey.odometry, float).reshape(-1, 4)
    if not len(rows) and odometry is not False and source in (None, _TF):
        found = survey.transforms.below("odom")
        if found is not None:
            robot, rows = found
            source = _TF
            report.moved = max(report.scans - 1, 0)
    if odometry and not len(rows):
        raise LogError(f"{path}: no odometry in {odometry}")
    mounts = {frame: _mount(path, survey.transforms, frame, robot) for _, frame in survey.frames}
    for topic, frame in sorted(survey.frames):
        if mounts[frame].known:
            report.T_robot_laser[topic] = mounts[frame].T_robot_laser
    if not len(rows):
        return BagLog(path, report, None, mounts)
    report.odometry = source
    order = np.argsort(rows[:, 0], kind="stable")
    stamps, poses = rows[order, 0], rows[order, 1:]
    poses[:, 2] = np.unwrap(poses[:, 2])
    return BagLog(path, report, (stamps, poses), mounts)


def _mount(path: Path, transforms: TransformTree, frame: str, robot: str) -> _Mount:
    """How the laser of a frame is mounted on the robot."""
    if frame == robot:
        return _Mount(np.zeros(3))
    joined = (base for base in (robot, *_BASES) if transforms.between(base, frame) is not None)
    base = next(joined, transforms.mounted_on(frame))
    T = transforms.between(base, frame)
    if T is None or base == frame:
        return _CENTRE
    tilt = math.acos(min(abs(float(T[2, 2])), 1.0))
    if tilt > _TILT:
        raise LogError(
            f"{path}: the frame {frame!r} is tilted by {math.degrees(tilt):.0f}° in {base!r}: "
            "its scans are not in the plane of the floor"
        )
    return _Mount(planar(T), upside_down=bool(T[2, 2] < 0))


def _reading(message: Any, time: int) -> _Reading:
    """The message of a scan as it is. Raises `ValueError` for echoes that are none."""
    ranges = message.ranges
    if len(ranges) > MOST_BEAMS:
        raise ValueError(f"{len(ranges)} readings are more than {MOST_BEAMS}")
    if isinstance(ranges, list):
        ranges = [echo.echoes[0] if len(echo.echoes) else math.nan for echo in ranges]
    stamp = _stamp(message.header, time)
    return _Reading(
        stamp=stamp,
        frame=_plain(message.header.frame_id),
        ranges=np.asarray(ranges, float),
        angle_min=float(message.angle_min),
        angle_increment=float(message.angle_increment),
        range_min=float(message.range_min),
        range_max=float(message.range_max),
    )


def _stamp(header: Any, time: int) -> float:
    """Seconds, by the log's own clock where the header has none."""
    stamp = header.stamp.sec + 1e-9 * header.stamp.nanosec
    return float(stamp) if stamp else 1e-9 * time


def _plain(frame: str) -> str:
    """A frame's name; ROS 1 may begin it with a slash."""
    return str(frame).removeprefix("/")


def _matrix(position: Any, rotation: Any) -> np.ndarray:
    return pose_matrix(
        (position.x, position.y, position.z), (rotation.x, rotation.y, rotation.z, rotation.w)
    )


def _is_laser(topic: Topic) -> bool:
    return topic.kind in LASER_TYPES


def _choose_lasers(
    path: Path, topics: list[Topic], lasers: Sequence[str] | None
) -> tuple[str, ...]:
    present = [topic for topic in topics if _is_laser(topic) and topic.messages]
    listed = ", ".join(f"{topic.name} ({topic.messages})" for topic in present)
    if not present:
        raise LogError(f"{path}: no topic of laser scans, only {_listed(topics)}")
    if lasers is None:
        if len(present) > 1:
            raise LogError(f"{path}: several topics of laser scans, choose one: {listed}")
        return (present[0].name,)
    for name in lasers:
        if name not in [topic.name for topic in present]:
            raise LogError(f"{path}: {name!r} is no topic of laser scans; there are {listed}")
    return tuple(lasers)


def _choose_odometry(
    path: Path, topics: list[Topic], odometry: str | Literal[False] | None
) -> str | None:
    present = [topic for topic in topics if topic.kind == ODOMETRY and topic.messages]
    listed = ", ".join(f"{topic.name} ({topic.messages})" for topic in present) or "none"
    if odometry is False:
        return None
    if odometry is None:
        if len(present) > 1:
            raise LogError(f"{path}: several topics of odometry, choose one: {listed}")
        return present[0].name if present else None
    if odometry != _TF and odometry not in [topic.name for topic in present]:
        raise LogError(f"{path}: {odometry!r} is no topic of odometry; there are {listed}")
    return None if odometry == _TF else odometry


def _listed(topics: list[Topic]) -> str:
    return ", ".join(f"{topic.name} ({topic.kind})" for topic in topics[:20]) or "no topic at all"
