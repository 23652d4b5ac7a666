"""The odometry of a CARMEN log, from its ODOM lines.

In a raw log these go on from scan to scan. In a corrected log the first one after a scan restates
the scan's pose, which is the truth, and wheel odometry goes on from there: a step across it would
leak the truth.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from aprjax.plane import compose, relative

_FAR = 1.0
"""Metres and radians: odometry that goes on does not jump so far from one line to the next."""
_SAME = 1e-6
"""Metres and radians, likewise, between a pose and one that restates it."""


class OdometrySurvey:
    """Whether the ODOM lines restart at each scan, and how many scans of each laser have a step.

    Poses of laser lines are compared with them for that, and serve nothing else.
    """

    def __init__(self) -> None:
        self._scans, self._lines = 0, 0
        self._steps, self._moved = Counter[str](), Counter[str]()
        self._restarts, self._goes_on = 0, 0
        self._last: np.ndarray | None = None
        self._before: np.ndarray | None = None
        self._stated: list[np.ndarray] = []

    def odom(self, pose: np.ndarray) -> None:
        """An ODOM line."""
        if self._lines == 0 and self._before is not None:
            far = np.abs(relative(self._before, pose))
            restated = any(np.all(np.abs(pose - each) < _SAME) for each in self._stated)
            if np.any(far > _SAME):
                if restated or np.any(far > _FAR):
                    self._restarts += 1
                else:
                    self._goes_on += 1
        self._lines += 1
        self._last = pose

    def laser(self, kind: str | None, stated: Sequence[np.ndarray | None] = ()) -> None:
        """A laser line and the poses that it states; without a kind, a damaged one."""
        if kind is not None:
            self._steps[kind] += self._scans > 0 and self._lines >= 2
            self._moved[kind] += self._scans > 0 and self._lines >= 1
            self._scans += 1
        if self._lines:
            self._stated = []
        self._stated += [pose for pose in stated if pose is not None]
        self._before, self._lines = self._last, 0

    @property
    def restarts(self) -> bool:
        """Where nothing tells, they are taken to: then no truth leaks."""
        return self._goes_on <= self._restarts

    def moved(self, kinds: Sequence[str]) -> int:
        """Scans of these lasers with a step of odometry since the scan before."""
        counts = self._steps if self.restarts else self._moved
        return sum(counts[kind] for kind in kinds)


class RestartingOdometry:
    """Steps from the first ODOM line after a laser line to the last before the next, composed."""

    def __init__(self) -> None:
        self._pose: np.ndarray | None = None
        self._first: np.ndarray | None = None
        self._last: np.ndarray | None = None

    def odom(self, pose: np.ndarray) -> None:
        """An ODOM line."""
        self._first = pose if self._first is None else self._first
        self._last = pose

    def laser(self) -> None:
        """A laser line, any and a damaged one too: a step does not go across it."""
        if self._pose is not None and self._first is not None and self._last is not None:
            self._pose = compose(self._pose, relative(self._first, self._last))
        self._first = self._last = None

    def at_scan(self) -> np.ndarray:
        """The pose `(3,)` in the frame of the first scan that was asked for, metres and radians."""
        if self._pose is None:
            self._pose = np.zeros(3)
        return self._pose.copy()


class ContinuousOdometry:
    """The last ODOM line before each scan."""

    def __init__(self) -> None:
        self._asked = False
        self._origin: np.ndarray | None = None
        self._last: np.ndarray | None = None

    def odom(self, pose: np.ndarray) -> None:
        """An ODOM line."""
        self._last = pose
        if self._asked and self._origin is None:
            self._origin = pose

    def laser(self) -> None:
        """A laser line, which changes nothing."""

    def at_scan(self) -> np.ndarray:
        """The pose `(3,)` in the frame of the first scan that was asked for, metres and radians."""
        if not self._asked:
            self._asked, self._origin = True, self._last
        if self._origin is None or self._last is None:
            return np.zeros(3)
        return relative(self._origin, self._last)
