"""Whether a scan goes on from the one before it: the tracking source that notices a kidnapping.

Wheels do not turn when a robot is carried away, and odometry then tells of no motion. Two scans of
one drive overlap; where they do not, the measured step is not what happened.
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import capacity, threshold
from aprjax.plane import transform
from aprjax.scan import Scan
from aprjax.tracking.hypothesis import Step

_SHARES = (1.0, 0.0, 0.5, 1.5)  # of the measured way: wheels slip
_TURNS = np.radians([0.0, -4.0, 4.0, -8.0, 8.0, -12.0, 12.0])  # beside the measured turn


class ContinuityConfig(eqx.Module):
    """When two scans overlap.

    A robot at rest sees the same again; the farther it went, the less of it. Within half a metre,
    99 of 100 pairs of successive scans of real drives share more than is asked here.
    """

    near: Float[Array, ""] = threshold(0.25, "metres from an end point of the scan before")
    nearer: Float[Array, ""] = threshold(0.1, "metres that are allowed less where it is at rest")
    broken: Float[Array, ""] = threshold(0.2, "share of near end points up to which nothing fits")
    whole: Float[Array, ""] = threshold(0.3, "share from which the step is not doubted")
    still: Float[Array, ""] = threshold(0.4, "what is asked more of both where it is at rest")
    fades: Float[Array, ""] = threshold(0.5, "metres over which both become less by a factor e")
    per_turn: Float[Array, ""] = threshold(0.5, "metres that a radian of turning counts")
    certainty: Float[Array, ""] = threshold(0.95, "doubt where nothing fits")
    points: int = capacity(90, "most end points of a scan that are compared")


class ScanContinuity:
    """Doubts a step if the new scan's end points do not lie on those of the scan before.

    A reading is a `Scan`. The step that other sources measured is tried with some slip and turn
    more or less; the best fit counts. It measures no motion itself.
    """

    reads = "scan"

    def __init__(self, config: ContinuityConfig | None = None) -> None:
        self.config = ContinuityConfig() if config is None else config
        self._last: np.ndarray | None = None

    def step(self, reading: Scan, expected: Step | None) -> Step | None:
        """A step that measures nothing, with its `doubt`; None for a first or an empty scan."""
        xy = end_points(reading, self.config.points)
        last, self._last = self._last, xy
        if last is None or expected is None or not len(xy) or not len(last):
            return None
        gone = expected.way + float(self.config.per_turn) * expected.turn
        resting = np.exp(-gone / float(self.config.fades))
        more = float(self.config.still) * resting
        broken, whole = float(self.config.broken) + more, float(self.config.whole) + more
        near = float(self.config.near) - float(self.config.nearer) * resting
        share = self._overlap(last, xy, expected.T_before_now, near, whole)
        doubt = float(np.clip((whole - share) / max(whole - broken, 1e-6), 0.0, 1.0))
        return Step.unmeasured(float(self.config.certainty) * doubt)

    def _overlap(
        self,
        before: np.ndarray,
        now: np.ndarray,
        T_before_now: np.ndarray,
        near: float,
        enough: float,
    ) -> float:
        """The largest share of end points near others, over the poses tried until it is enough."""
        best = 0.0
        for share in _SHARES:
            for turn in _TURNS:
                tried = T_before_now * [share, share, 1.0] + [0.0, 0.0, turn]
                gap = np.min(_square_distances(transform(tried, now), before), axis=1)
                best = max(best, float(np.mean(gap < near**2)))
                if best >= enough:
                    return best
        return best

    def state(self) -> list[list[float]] | None:
        """The last scan's end points."""
        return None if self._last is None else self._last.tolist()

    def restore(self, state: Sequence[Sequence[float]] | None) -> None:
        """Go on from end points that `state` returned."""
        self._last = None if state is None else np.array(state, float).reshape(-1, 2)


def end_points(scan: Scan, most: int) -> np.ndarray:
    """At most `most` hits `(n, 2)` in metres in the laser's frame, evenly spread over the beams."""
    beams = int(scan.beams)
    ranges = np.asarray(scan.ranges, float)[:beams]
    angles = float(scan.angle_min) + float(scan.angle_increment) * np.arange(beams)
    # `Scan.hit`, without a call to JAX for every scan of a drive.
    hits = np.flatnonzero((ranges >= float(scan.range_min)) & (ranges <= float(scan.range_max)))
    hits = hits[np.linspace(0, len(hits) - 1, min(most, len(hits))).astype(int)]
    return np.stack([np.cos(angles[hits]), np.sin(angles[hits])], axis=-1) * ranges[hits, None]


def _square_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    x, y = a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1]
    return x * x + y * y
