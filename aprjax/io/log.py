"""Logs of any format: their entries, and what was found in them."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aprjax.scan import Scan

LISTED = 100
"""Damaged lines and unknown kinds that a report spells out."""


class LogError(ValueError):
    """A log that cannot be used. One line: the path, the line number if there is one, and why."""


@dataclass(frozen=True, eq=False)
class LogEntry:
    """One scan of a log."""

    scan: Scan
    """On the host, with codes and saturation values turned into invalid beams and no returns."""
    odometry: np.ndarray | None
    """Pose `(3,)` in an odometry frame, metres and radians, None where the log has none: of the
    laser in a bag, of the robot in a CARMEN log, whose laser is taken to be at its centre."""
    stamp: float
    """Seconds as logged; they may be constant, restart or wrap, so they order nothing."""
    laser: str
    """The message's name, such as FLASER, or its topic in a bag."""
    logged_pose: np.ndarray | None
    """Laser pose `(3,)` on the scan's line. In a corrected log it is the truth: only to score."""
    line: int
    """Number of the line, or of the scan's message in a bag, from 1."""


@dataclass
class LogReport:
    """What a log holds, and what of it was left out."""

    kind: str = "CARMEN log"
    unit: str = "line"
    """What is counted: a line of a log, a message of a bag."""
    lines: int = 0
    """How many of them there are."""
    scans: int = 0
    """Intact scans of the chosen lasers: as many as an iteration yields."""
    lasers: tuple[str, ...] = ()
    """The chosen laser messages, or topics."""
    other_lasers: int = 0
    """Intact scans of lasers that were not chosen."""
    messages: Counter[str] = field(default_factory=Counter)
    """Lines of each known kind, or messages of each topic, damaged ones included."""
    unknown: Counter[str] = field(default_factory=Counter)
    """Skipped lines of each unknown kind; past a hundred kinds, the others are `(other)`."""
    damaged: list[tuple[int, str]] = field(default_factory=list)
    """Number and reason of the first hundred damaged lines or messages; they were skipped."""
    damaged_lines: int = 0
    saturations: dict[str, float] = field(default_factory=dict)
    """Metres, for each chosen laser that saturates."""
    moved: int = 0
    """Chosen scans with a step of odometry since the scan before, be it at rest. Where odometry is
    read more seldom than scans, `moved` is far below `scans`."""

    odometry: str | None = None
    """Where a bag's odometry comes from: a topic, `/tf`, or nowhere."""
    T_robot_laser: dict[str, np.ndarray] = field(default_factory=dict)
    """`(3,)`, metres and radians: how the transforms of a bag say that the chosen lasers are
    mounted. A laser that is not in it is taken to be at the robot's centre."""

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


class Log(ABC):
    """A surveyed log: its `report`, and its scans, a `LogEntry` each, however often iterated.

    Iteration raises `LogError` if the file can no longer be read.
    """

    def __init__(self, path: Path, report: LogReport) -> None:
        self.path = path
        self.report = report

    @abstractmethod
    def __iter__(self) -> Iterator[LogEntry]:
        """The scans in their order."""
