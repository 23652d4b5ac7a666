"""CARMEN logs, plain or gzipped, as a stream of scans with odometry.

A first pass surveys the file: its lasers, its damage, and the value at which each scanner
saturates. Every iteration then streams it again, so that memory does not grow with the log.
"""

import gzip
import math
import os
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aprjax.scan import Scan

LASERS = (
    *("ROBOTLASER1", "FLASER", "RAWLASER1"),
    *("ROBOTLASER2", "RLASER", "RAWLASER2"),
    *("LASER3", "RAWLASER3", "LASER4", "RAWLASER4"),
)
"""Laser messages, the preferred one first: the same scans are often logged as two of them."""

# The old laser messages state no angles; PARAM lines may, under these names.
_OLD_LASERS = {
    "FLASER": "front_laser",
    "RLASER": "rear_laser",
    "LASER3": "laser3",
    "LASER4": "laser4",
}
_OTHER_KINDS = ("ODOM", "PARAM", "VERTEX2", "EDGE2", "TRUEPOS", "SYNC")

_RANGE_MIN, _RANGE_MAX = 0.02, 80.0  # metres, where the log shows no others
_SICK_ABOVE_MAXIMUM = 81.83
_SICK_CODES = 81.825  # metres: this and all above it is a code
_BINS = 81_830  # a histogram of the readings below the codes, a millimetre each
_LONGEST_LINE = 1 << 20  # bytes: a hundred thousand readings
_LISTED = 100  # damaged lines and unknown kinds that a report spells out


class LogError(ValueError):
    """A log that cannot be used. One line: the path, the line number if there is one, and why."""


@dataclass(frozen=True, eq=False)
class LogEntry:
    """One scan of a log."""

    scan: Scan
    """On the host, with codes and saturation values turned into invalid beams and no returns."""
    odometry: np.ndarray | None
    """Robot pose `(3,)` in an odometry frame, metres and radians; None where the log has none."""
    stamp: float
    """Seconds as logged; they may be constant, restart or wrap, so they order nothing."""
    laser: str
    """The message's name, such as FLASER."""
    logged_pose: np.ndarray | None
    """Laser pose `(3,)` on the scan's line. In a corrected log it is the truth: only to score."""
    line: int
    """Line number, from 1."""


@dataclass
class LogReport:
    """What a log holds, and what of it was left out."""

    lines: int = 0
    scans: int = 0
    """Intact scans of the chosen lasers: as many as an iteration yields."""
    lasers: tuple[str, ...] = ()
    """The chosen laser messages."""
    other_lasers: int = 0
    """Intact scans of lasers that were not chosen."""
    messages: Counter[str] = field(default_factory=Counter)
    """Lines of each known kind, damaged ones included."""
    unknown: Counter[str] = field(default_factory=Counter)
    """Skipped lines of each unknown kind; past a hundred kinds, the others are `(other)`."""
    damaged: list[tuple[int, str]] = field(default_factory=list)
    """Line number and reason of the first hundred damaged lines; they were skipped."""
    damaged_lines: int = 0
    saturations: dict[str, float] = field(default_factory=dict)
    """Metres, for each chosen laser that saturates."""
    moved: int = 0
    """Chosen scans with two or more ODOM lines since the scan before. Only these can have a step of
    odometry: where ODOM lines are few, `moved` far below `scans` shows it."""

    @property
    def saturation(self) -> float | None:
        """Saturation value in metres of the first chosen laser that saturates."""
        return next(iter(self.saturations.values()), None)

    @property
    def vertices(self) -> int:
        """VERTEX2 lines."""
        return self.messages["VERTEX2"]

    @property
    def edges(self) -> int:
        """EDGE2 lines."""
        return self.messages["EDGE2"]


class Log:
    """A surveyed log: its `report`, and its scans, a `LogEntry` each, however often iterated.

    Odometry: where the log has ODOM lines, the step to a scan goes from the first ODOM after the
    scan before it to the last ODOM before itself. In a corrected log that first one restates the
    truth, and a step across it would leak the truth; so any laser line ends a step, one of
    another laser or a damaged one too. `odometry` composes the steps from (0, 0, 0) at the first
    scan. Without ODOM lines it is the robot pose of a ROBOTLASER line, never a FLASER's.

    Iteration raises `LogError` if the file can no longer be read.
    """

    def __init__(
        self,
        path: Path,
        report: LogReport,
        params: dict[str, float],
        ranging: dict[str, "_Ranging"],
    ) -> None:
        self.path = path
        self.report = report
        self._params = params
        self._ranging = ranging

    def __iter__(self) -> Iterator[LogEntry]:
        use_odom = self.report.messages["ODOM"] > 0
        pose = first = last = None
        for number, words in _lines(self.path):
            kind = words[0] if words else ""
            if kind not in LASERS and kind != "ODOM":
                continue
            try:
                message = _parse(kind, words, self._params)
            except ValueError:
                message = None
            if kind == "ODOM":
                last = message if isinstance(message, np.ndarray) else last
                first = last if first is None else first
                continue
            if pose is not None and first is not None and last is not None:
                pose = _compose(pose, _relative(first, last))
            first = last = None
            if kind in self._ranging and isinstance(message, _Sweep):
                pose = np.zeros(3) if pose is None else pose
                yield LogEntry(
                    scan=self._ranging[kind].scan(message),
                    odometry=pose.copy() if use_odom else message.robot_pose,
                    stamp=message.stamp,
                    laser=kind,
                    logged_pose=message.laser_pose,
                    line=number,
                )


def read_log(
    path: str | os.PathLike[str], *, lasers: Sequence[str] | None = None, strict: bool = False
) -> Log:
    """Survey a CARMEN log, plain or gzipped, and return it ready to be iterated.

    `lasers` names the messages to take, such as `("FLASER", "RLASER")`; the default is the one
    kind that comes first in `LASERS`. Unknown lines are skipped and counted; so are damaged ones,
    with the reason, unless `strict`, which raises at the first.

    FLASER, RLASER, LASER3 and LASER4 state no angles: they start at -90° with the resolution of
    a PARAM line, or without a sensible one cover 180°, both ends (n - 1 steps) if n is odd and
    one (n steps) if it is even. The other messages' angles are start + i * resolution; their
    field of view is not used, for it is often a step off.

    Raises `LogError` for a file that cannot be read, is cut off or corrupt, or has no scan of the
    lasers asked for, and `ValueError` for a laser that does not exist.
    """
    for name in lasers or ():
        if name not in LASERS:
            raise ValueError(f"lasers: {name!r} is none of {', '.join(LASERS)}")
    path = Path(path)
    report, params = LogReport(), dict[str, float]()
    scans, moved = Counter[str](), Counter[str]()
    readings: dict[str, np.ndarray] = defaultdict(lambda: np.zeros(_BINS, np.int64))
    odoms = 0
    for number, words in _lines(path):
        report.lines = number
        kind = words[0] if words else ""
        if kind not in LASERS and kind not in _OTHER_KINDS:
            if kind:
                listed = kind in report.unknown or len(report.unknown) < _LISTED
                report.unknown[kind if listed else "(other)"] += 1
            continue
        report.messages[kind] += 1
        try:
            message = _parse(kind, words, params)
        except ValueError as error:
            if strict:
                raise LogError(f"{path}: line {number}: {error}") from None
            report.damaged_lines += 1
            if len(report.damaged) < _LISTED:
                report.damaged.append((number, str(error)))
            message = None
        if isinstance(message, _Sweep):
            moved[kind] += odoms >= 2 and scans.total() > 0
            scans[kind] += 1
            readings[kind] += _in_millimetres(message.ranges)
        if kind in LASERS:
            odoms = 0
        elif isinstance(message, np.ndarray):
            odoms += 1

    chosen = tuple(lasers) if lasers else tuple(name for name in LASERS if scans[name])[:1]
    report.lasers = chosen
    report.scans = sum(scans[name] for name in chosen)
    report.other_lasers = scans.total() - report.scans
    report.moved = sum(moved[name] for name in chosen)
    if not report.scans:
        raise LogError(f"{path}: {_why_empty(report, scans)}")
    ranging = {name: _Ranging(readings[name]) for name in chosen if scans[name]}
    report.saturations = {
        name: each.saturation for name, each in ranging.items() if each.saturation is not None
    }
    return Log(path, report, params, ranging)


def _why_empty(report: LogReport, scans: Counter[str]) -> str:
    if not report.lines:
        return "the file is empty"
    if report.other_lasers:
        present = ", ".join(name for name in LASERS if scans[name])
        return f"no scan of {', '.join(report.lasers)}, only of {present}"
    if report.damaged:
        number, reason = report.damaged[0]
        return f"no intact scan, {report.damaged_lines} damaged lines; line {number}: {reason}"
    return f"not a CARMEN log: no scan in {report.lines} lines"


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and words, none for a blank line or a comment.

    A line over a megabyte is read only so far, and its count of fields shows the damage.
    """
    number = 0
    try:
        with path.open("rb") as file:
            packed = file.read(2) == b"\x1f\x8b"
        with gzip.open(path) if packed else path.open("rb") as stream:
            while line := stream.readline(_LONGEST_LINE):
                number += 1
                rest = line
                while len(rest) == _LONGEST_LINE and not rest.endswith(b"\n"):
                    rest = stream.readline(_LONGEST_LINE)
                words = line.decode(errors="replace").split()
                yield number, [] if words and words[0].startswith("#") else words
    except EOFError:
        raise LogError(f"{path}: cut off: its gzip data ends after line {number}") from None
    except (gzip.BadGzipFile, zlib.error) as error:
        raise LogError(f"{path}: corrupt gzip data after line {number}: {error}") from None
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from None


@dataclass(frozen=True, eq=False)
class _Sweep:
    """A laser line, its ranges as logged; None for what its kind does not state."""

    ranges: np.ndarray
    start: float
    resolution: float
    maximum: float | None
    laser_pose: np.ndarray | None
    robot_pose: np.ndarray | None
    stamp: float


def _parse(kind: str, words: list[str], params: dict[str, float]) -> _Sweep | np.ndarray | None:
    """A laser line's sweep, an ODOM line's pose; None for other kinds. PARAMs go into `params`.

    Raises `ValueError` that says what is damaged.
    """
    if kind in _OLD_LASERS:
        return _old_sweep(kind, words, params)
    if kind in LASERS:
        return _sweep(words, robot=kind.startswith("ROBOT"))
    if kind == "ODOM":
        _expect(words, at_least=10)
        return _pose(words[1:4])
    if kind == "PARAM":
        _keep_param(words[1:3], params)
    elif kind == "VERTEX2":
        _expect(words, at_least=5)
        _pose(words[2:5])
    elif kind == "EDGE2":
        _expect(words, at_least=6)
        _pose(words[3:6])
    return None


def _keep_param(name_value: list[str], params: dict[str, float]) -> None:
    """Keep a positive number under its name; other values state no resolution and no maximum."""
    try:
        name, value = name_value[0], float(name_value[1])
    except (IndexError, ValueError):
        return
    if 0 < value < math.inf:
        # Old logs write laser_frontlaser_resolution for laser_front_laser_resolution.
        params[name.replace("frontlaser", "front_laser").replace("rearlaser", "rear_laser")] = value


def _old_sweep(kind: str, words: list[str], params: dict[str, float]) -> _Sweep:
    """NAME n ranges, laser x y theta, odometry x y theta, time host time."""
    n = _count(words, 1)
    _expect(words, 2 + n + 9)
    name, turn = _OLD_LASERS[kind], max(n - 1, 1)
    resolution = params.get(f"laser_{name}_resolution", 0.0)
    if not 0 < resolution * turn <= 360:
        resolution = 180 / (turn if n % 2 else n)
    return _Sweep(
        ranges=_numbers(words[2 : 2 + n]),
        start=-math.pi / 2,
        resolution=math.radians(resolution),
        maximum=params.get(f"robot_{name}_max"),
        laser_pose=_pose(words[2 + n : 5 + n]),
        robot_pose=None,
        stamp=_pose(words[8 + n : 9 + n])[0],
    )


def _sweep(words: list[str], *, robot: bool) -> _Sweep:
    """NAME type start fov resolution maximum accuracy mode n ranges m remissions, then the tail.

    The tail is time host time, before it for ROBOTLASER laser x y theta, robot x y theta and five
    numbers more.
    """
    n = _count(words, 8)
    m = _count(words, 9 + n, least=0)
    tail = 10 + n + m
    _expect(words, tail + (14 if robot else 3))
    start, _, resolution, maximum = _numbers(words[2:6])
    if not (abs(start) <= 2 * math.pi and 1e-6 < abs(resolution) * max(n - 1, 1) <= 6.29):
        raise ValueError(f"{n} readings from {start} rad at {resolution} rad are no field of view")
    return _Sweep(
        ranges=_numbers(words[9 : 9 + n]),
        start=start,
        resolution=resolution,
        maximum=maximum,
        laser_pose=_pose(words[tail : tail + 3]) if robot else None,
        robot_pose=_pose(words[tail + 3 : tail + 6]) if robot else None,
        stamp=_pose(words[-3:-2])[0],
    )


def _count(words: list[str], index: int, least: int = 1) -> int:
    _expect(words, at_least=index + 1)
    word = words[index]
    if not (word.isdecimal() and len(word) < 10 and int(word) >= least):
        raise ValueError(f"{word[:20]!r} is not a count of readings")
    return int(word)


def _expect(words: list[str], exactly: int | None = None, *, at_least: int = 0) -> None:
    if len(words) < at_least or exactly not in (None, len(words)):
        raise ValueError(f"{words[0]} has {len(words)} fields, not {exactly or at_least}")


def _numbers(words: list[str]) -> np.ndarray:
    try:
        return np.array(list(map(float, words)))
    except ValueError as error:
        raise ValueError(f"not a number: {str(error).partition(': ')[2][:20]}") from None


def _pose(words: list[str]) -> np.ndarray:
    pose = _numbers(words)
    if not np.isfinite(pose).all():
        raise ValueError(f"not finite: {' '.join(words)}")
    return pose


class _Ranging:
    """What the readings of one laser mean, judged by all of them."""

    def __init__(self, counts: np.ndarray) -> None:
        """`counts` are the log's readings of each length in whole millimetres."""
        self._longer = counts[::-1].cumsum()[::-1]
        self.saturation = saturation_value(counts)

    def scan(self, sweep: _Sweep) -> Scan:
        """The sweep's ranges as REP 117 has them.

        No return: +inf, SICK's code 81.83 for above maximum, and a reading at the limit; beyond
        it too if the limit is a saturation value. Invalid: other codes (81.87 signal too weak,
        81.89 overflow, 81.90 dazzled, 81.91 not valid) and anything else beyond the limit, not
        positive or not a number.
        """
        ranges, limit = sweep.ranges, self.limit(sweep.maximum)
        with np.errstate(invalid="ignore"):
            code = ranges >= _SICK_CODES
            free = np.isposinf(ranges) | (abs(ranges - _SICK_ABOVE_MAXIMUM) <= 0.005)
            if self.saturation is not None:
                free |= ~code & (ranges > self.saturation - 0.001)
            elif limit is not None:
                free |= abs(ranges - limit) <= 0.001
            invalid = code | (ranges <= 0)
        range_max = limit or _RANGE_MAX
        return Scan.make(
            np.where(free, np.inf, np.where(invalid, np.nan, ranges)),
            angle_min=sweep.start,
            angle_increment=sweep.resolution,
            range_min=_RANGE_MIN,
            range_max=range_max,
        )

    def limit(self, header: float | None) -> float | None:
        """The laser's range in metres: its saturation value, else a header's believable maximum.

        That is one between 1 m and SICK's codes which at most a thousandth of the readings
        exceed.
        """
        if self.saturation is not None:
            return self.saturation
        if header is None or not 1 <= header < _SICK_CODES:
            return None
        exceeding = self._longer[round(header * 1e3) + 1]
        return header if exceeding <= self._longer[0] / 1e3 else None


def saturation_value(counts: np.ndarray) -> float | None:
    """The length in metres that a scanner reports for all that is farther, None without one.

    `counts[i]` is how often a log reads i millimetres, SICK's codes left out. A saturation value
    is a sharp peak at the very end of this histogram. It is read at least 20 times, and ten times
    as often as any value from 80 % of its length up to it. Longer readings, which some scanners
    jitter up to (51.05 and some 51.10), are at most a quarter as many. Isolated far readings fail
    the first test. So does a wall that a standing robot looks at: noise spreads its readings to
    both sides, and its width to the far one. (A wall of a few beams, the farthest of the log and
    with less noise than a reading's last digit, is mistaken.) And the log must hold 20 different
    shorter values, or nothing says that a constant is not what there was to see.
    """
    longer = counts[::-1].cumsum()[::-1]
    for value in np.flatnonzero(counts >= 20)[::-1]:
        peak = counts[value]
        ordinary = counts[int(0.8 * value) : value].max(initial=0)
        if 4 * (longer[value] - peak) <= peak >= 10 * ordinary:
            varied = np.count_nonzero(counts[:value]) >= 20
            return float(value) / 1e3 if varied else None
    return None


def _in_millimetres(ranges: np.ndarray) -> np.ndarray:
    below = ranges[(ranges > 0) & (ranges < _SICK_CODES)]
    return np.bincount(np.rint(below * 1e3).astype(np.int64), minlength=_BINS)


def _compose(T_a_b: np.ndarray, T_b_c: np.ndarray) -> np.ndarray:
    cos, sin = math.cos(T_a_b[2]), math.sin(T_a_b[2])
    x, y, theta = T_b_c
    turned = np.array([cos * x - sin * y, sin * x + cos * y, theta])
    turned += T_a_b
    turned[2] = math.remainder(turned[2], math.tau)
    return turned


def _relative(T_a_b: np.ndarray, T_a_c: np.ndarray) -> np.ndarray:
    """`T_b_c`."""
    cos, sin = math.cos(T_a_b[2]), math.sin(T_a_b[2])
    x, y, theta = T_a_c - T_a_b
    return np.array([cos * x + sin * y, cos * y - sin * x, theta])
