"""Scan matching as tracking source: each scan is aligned with the one before it.

Wheels slip, most of all in turns; two scans of one drive overlap and say how the robot turned to a
fraction of a degree.
"""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import Packed, check_kind, threshold
from aprjax.evaluation.view import View
from aprjax.features import FeatureConfig
from aprjax.plane import wrap
from aprjax.scan import Scan
from aprjax.tracking.hypothesis import Step
from aprjax.tracking.views import scan_of_state, state_of_scan, view_of
from aprjax.world.alignment import AlignConfig, align_two
from aprjax.world.motion import MotionConfig, doubted, turned

_TURNS = np.radians([0, -5, 5, -10, 10, -18, 18])


class ScanMotionConfig(eqx.Module):
    """When an aligned step is believed."""

    align: AlignConfig = AlignConfig()
    motion: MotionConfig = MotionConfig()
    agreement: Float[Array, ""] = threshold(0.1, "least agreement of the two scans")
    gate: Float[Array, ""] = threshold(12.0, "χ² of three numbers: most that odometry allows")
    slack: Float[Array, ""] = threshold(0.1, "metres of deviation that odometry is granted besides")
    turn_slack: Float[Array, ""] = threshold(0.03, "radians, likewise")


class ScanMotion:
    """Steps from scans that agree with each other and are not at odds with odometry.

    A reading is a `Scan`. The step that the sources before it measured is where it starts from,
    so that it comes after odometry; without one it measures nothing.
    """

    reads = "scan"

    def __init__(
        self, config: ScanMotionConfig | None = None, features: FeatureConfig | None = None
    ) -> None:
        """Configurations are taken as they are now. Raises `ValueError` for another kind."""
        self.config = ScanMotionConfig() if config is None else config
        self.features = FeatureConfig() if features is None else features
        check_kind("config", self.config, ScanMotionConfig)
        check_kind("features", self.features, FeatureConfig)
        self._described_by = Packed.of(self.features, "features")
        self._align = Packed.of(self.config.align, "config.align")
        self._last: tuple[Scan, View] | None = None

    def step(self, reading: Scan, expected: Step | None) -> Step | None:
        """The aligned motion since the last scan, or None."""
        last, now = self._last, view_of(reading, self._described_by)
        self._last = reading, now
        if last is None or expected is None or last[1].xy.shape != now.xy.shape:
            return None
        starts = turned(expected.T_before_now, _TURNS)
        T, covariance, agreement = align_two(last[1], now, starts, self._align)
        covariance = doubted(covariance, agreement, self.config.motion)
        off = T - expected.T_before_now
        off[2] = wrap(off[2])
        slack = np.square([float(self.config.slack)] * 2 + [float(self.config.turn_slack)])
        square = off @ np.linalg.solve(expected.covariance + np.diag(slack), off)
        if agreement < self.config.agreement or square > self.config.gate:
            return None
        return Step(T, covariance)

    def state(self) -> dict[str, Any] | None:
        """The last scan."""
        return None if self._last is None else state_of_scan(self._last[0])

    def restore(self, state: dict[str, Any] | None) -> None:
        """Go on from a scan that `state` returned."""
        scan = None if state is None else scan_of_state(state)
        self._last = None if scan is None else (scan, view_of(scan, self._described_by))
