"""CARMEN logs, plain or gzipped, as a stream of scans with odometry.

A first pass surveys the file: its lasers, its damage, and the value at which each scanner
saturates. Every iteration then streams it again, so that memory does not grow with the log.
"""

import gzip
import os
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from aprjax.io.carmen_odometry import ContinuousOdometry, OdometrySurvey, RestartingOdometry
from aprjax.io.files import most_unpacked, open_file
from aprjax.io.log import LISTED, Log, LogEntry, LogError, LogReport
from aprjax.io.messages import LASERS, OTHER_KINDS, Sweep, parse
from aprjax.io.ranging import BINS, Ranging, in_millimetres

_LONGEST_LINE = 1 << 20  # bytes: a hundred thousand readings


class CarmenLog(Log):
    """A CARMEN log.

    Odometry: where the log has ODOM lines, it is that of the last one before each scan, from
    (0, 0, 0) at the first. In a corrected log they restart at the truth after each laser line;
    there, the step to a scan goes from the first after the line before to the last before its own
    (see `aprjax.io.carmen_odometry`). Without ODOM lines between scans it is the robot pose of
    a ROBOTLASER line, never a FLASER's.
    """

    def __init__(
        self,
        path: Path,
        report: LogReport,
        params: dict[str, float],
        ranging: dict[str, "Ranging"],
        *,
        restarts: bool,
    ) -> None:
        super().__init__(path, report)
        self._restarts = restarts
        self._params = params
        self._ranging = ranging

    def __iter__(self) -> Iterator[LogEntry]:
        told = self.report.messages["ODOM"] > 0
        odometry = RestartingOdometry() if self._restarts else ContinuousOdometry()
        found = 0
        for number, words in _lines(self.path):
            kind = words[0] if words else ""
            if kind not in LASERS and kind != "ODOM":
                continue
            try:
                message = parse(kind, words, self._params)
            except ValueError:
                message = None
            if kind == "ODOM":
                if isinstance(message, np.ndarray):
                    odometry.odom(message)
                continue
            odometry.laser()
            if kind in self._ranging and isinstance(message, Sweep):
                pose, stated = odometry.at_scan(), message.robot_pose
                found += 1
                yield LogEntry(
                    scan=self._ranging[kind].scan(message),
                    odometry=pose if self.report.moved or (told and stated is None) else stated,
                    stamp=message.stamp,
                    laser=kind,
                    logged_pose=message.laser_pose,
                    line=number,
                )
        if found != self.report.scans:
            raise LogError(
                f"{self.path}: changed: {found} scans where the survey found {self.report.scans}"
            )


def read_carmen(
    path: str | os.PathLike[str], *, lasers: Sequence[str] | None = None, strict: bool = False
) -> CarmenLog:
    """Survey a CARMEN log, plain or gzipped, and return it ready to be iterated.

    `lasers` names the messages to take, such as `("FLASER", "RLASER")`; the default is the one
    kind that comes first in `LASERS`. Unknown lines are skipped and counted; so are damaged ones,
    with the reason, unless `strict`, which raises at the first.

    FLASER, RLASER, LASER3 and LASER4 state no angles: they start at -90° with the resolution of
    a PARAM line, or without a sensible one cover 180°, both ends (n - 1 steps) if n is odd and
    one (n steps) if it is even. The other messages' angles are start + i * resolution; their
    field of view is not used, for it is often a step off.

    Raises `LogError` for a file that cannot be read (a pipe cannot: it is read twice), is cut off
    or corrupt, has no scan of the lasers asked for, or whose gzip data unpack to over 64 MiB and
    over 100 times its size; and `ValueError` for a laser that does not exist. A scan of over 2¹⁶
    readings is damaged.
    """
    for name in lasers or ():
        if name not in LASERS:
            raise ValueError(f"lasers: {name!r} is none of {', '.join(LASERS)}")
    path = Path(path)
    report, params = LogReport(), dict[str, float]()
    scans, odometry = Counter[str](), OdometrySurvey()
    readings: dict[str, np.ndarray] = defaultdict(lambda: np.zeros(BINS, np.int64))
    for number, words in _lines(path):
        report.lines = number
        kind = words[0] if words else ""
        if kind not in LASERS and kind not in OTHER_KINDS:
            if kind:
                listed = kind in report.unknown or len(report.unknown) < LISTED
                report.unknown[kind if listed else "(other)"] += 1
            continue
        report.messages[kind] += 1
        try:
            message = parse(kind, words, params)
        except ValueError as error:
            if strict:
                raise LogError(f"{path}: line {number}: {error}") from None
            report.damaged_lines += 1
            if len(report.damaged) < LISTED:
                report.damaged.append((number, str(error)))
            message = None
        if isinstance(message, Sweep):
            scans[kind] += 1
            readings[kind] += in_millimetres(message.ranges)
            odometry.laser(kind, (message.laser_pose, message.robot_pose))
        elif isinstance(message, np.ndarray):
            odometry.odom(message)
        elif kind in LASERS:
            odometry.laser(None)

    chosen = tuple(lasers) if lasers else tuple(name for name in LASERS if scans[name])[:1]
    report.lasers = chosen
    report.scans = sum(scans[name] for name in chosen)
    report.other_lasers = scans.total() - report.scans
    report.moved = odometry.moved(chosen)
    if not report.scans:
        raise LogError(f"{path}: {_why_empty(report, scans)}")
    ranging = {name: Ranging(readings[name]) for name in chosen if scans[name]}
    report.saturations = {
        name: each.saturation for name, each in ranging.items() if each.saturation is not None
    }
    return CarmenLog(path, report, params, ranging, restarts=odometry.restarts)


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
        with open_file(path) as file:
            packed = file.read(2) == b"\x1f\x8b"
            size = os.fstat(file.fileno()).st_size
        left = most_unpacked(size)  # never less than a plain file has
        ended = True
        with gzip.open(path) if packed else path.open("rb") as stream:
            while piece := stream.readline(_LONGEST_LINE):
                left -= len(piece)
                if left < 0:
                    raise LogError(
                        f"{path}: unpacks to over {most_unpacked(size)} bytes, too many for its "
                        f"{size}"
                    )
                begins, ended = ended, piece.endswith(b"\n")
                if not begins:
                    continue
                number += 1
                words = piece.decode(errors="replace").split()
                yield number, [] if words and words[0].startswith("#") else words
    except EOFError:
        raise LogError(f"{path}: cut off: its gzip data ends after line {number}") from None
    except (gzip.BadGzipFile, zlib.error) as error:
        raise LogError(f"{path}: corrupt gzip data after line {number}: {error}") from None
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from None
