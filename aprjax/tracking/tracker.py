"""Probabilistic position tracking in the world model: section 4.A of the paper.

`evidence` states the probability model, and where it departs from the paper.
"""

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import check_kind, threshold
from aprjax.tracking.apr import AprSource
from aprjax.tracking.belief import Belief
from aprjax.tracking.checked import (
    checked_estimates,
    checked_sources,
    checked_step,
    checked_verdicts,
)
from aprjax.tracking.clock import Clock
from aprjax.tracking.continuity import ScanContinuity
from aprjax.tracking.evidence import (
    EvidenceConfig,
    judged,
    located,
    moved,
    travelled,
    weight,
)
from aprjax.tracking.fusion import Motion
from aprjax.tracking.hypothesis import Hypothesis, Step
from aprjax.tracking.neighbours import Neighbours, merge
from aprjax.tracking.odometry import WheelOdometry
from aprjax.tracking.scan_motion import ScanMotion
from aprjax.tracking.sources import (
    PrimarySource,
    Remembers,
    TrackingSource,
    ValidationSource,
)
from aprjax.tracking.state import belief_of_state, state_of_belief
from aprjax.tracking.validation import IdcSource
from aprjax.world.model import WorldModel

_log = logging.getLogger(__name__)


class TrackerConfig(eqx.Module):
    """The probability model, and what is made of sources that are silent or late."""

    evidence: EvidenceConfig = EvidenceConfig()
    reach: Float[Array, ""] = threshold(30.0, "metres along arcs between poses that are compared")
    unmeasured: Float[Array, ""] = threshold(
        0.3, "deviation of a step's numbers that no source measures: metres, radians", least=1e-6
    )
    silence: Float[Array, ""] = threshold(3.0, "seconds without motion measured that are allowed")
    speed: Float[Array, ""] = threshold(
        0.3, "metres and radians per second: deviation of motion in silence"
    )
    astray: Float[Array, ""] = threshold(
        3.0, "metres, and radians up to one: most of it between two readings"
    )
    late: Float[Array, ""] = threshold(60.0, "seconds; an older stamp is that of a new clock")


class HypothesisTracker:
    """Position hypotheses in a world model, fed by sources of three kinds.

    Call `move` with what tracking sources read and `observe` with what the others do, in the order
    in which it was measured; `belief` is the answer at any time. Whatever the sources do, neither
    raises: what cannot be used is logged and left out. The world model must not be edited
    meanwhile.
    """

    def __init__(
        self,
        world: WorldModel,
        *,
        primary: Iterable[PrimarySource] | None = None,
        tracking: Iterable[TrackingSource] | None = None,
        validation: Iterable[ValidationSource] | None = None,
        config: TrackerConfig | None = None,
    ) -> None:
        """By default, the matcher is the primary source, motion comes from wheel odometry, and
        iterative dual correspondence validates.

        If `move` is given the scans too, `ScanMotion` makes it better and `ScanContinuity` notices
        kidnappings. Tracking sources are asked in their order. Raises `ValueError` for another
        kind of world or configuration, and naming what is no source of its kind.
        """
        check_kind("world", world, WorldModel)
        self.world = world
        self.config = TrackerConfig() if config is None else config
        check_kind("config", self.config, TrackerConfig)
        primary = (AprSource(),) if primary is None else primary
        tracking = motion_sources(world) if tracking is None else tracking
        validation = (IdcSource(),) if validation is None else validation
        self.primary = checked_sources("primary", primary, "locate")
        self.tracking = checked_sources("tracking", tracking, "step")
        self.validation = checked_sources("validation", validation, "judge")
        self.belief = Belief()
        self._near = Neighbours(world, float(self.config.reach))
        self._motion = Motion(float(self.config.unmeasured))
        self._way = 0.0
        self._heard: dict[str, float] = {}  # the way at each source's last reading
        self._clock = Clock(float(self.config.late))
        self._measured: float | None = None  # the stamp of the last motion measured
        self._silent = False  # whether that is long ago
        self._unread: set[str] = set()  # names of readings that were said to be nobody's

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """The most probable first."""
        return self.belief.hypotheses

    @property
    def rest(self) -> float:
        """λ_0."""
        return self.belief.rest

    def move(self, stamp: float | None = None, **readings: Any) -> Belief:
        """Carry all hypotheses on by what the tracking sources make of their readings.

        `readings` are named as the sources' `reads`, such as `odometry` or `gyro`; one that is
        missing is no error, and one that no source of the tracker reads is logged, once. `stamp` is
        their time in seconds.
        """
        self._check_names("move", readings)
        readings = self._clock.timely("move", stamp, readings)
        step = self._motion.step(self.tracking, readings, self._measure)
        if step is not None:
            if self._motion.complete:
                timed = stamp is not None and math.isfinite(stamp)
                self._measured, self._silent = stamp if timed else None, False
            self._advance(step)
        return self.belief

    def observe(self, stamp: float | None = None, **readings: Any) -> Belief:
        """Confirm, punish, create and validate hypotheses by what the other sources read."""
        self._check_names("observe", readings)
        timely = self._clock.timely("observe", stamp, readings)
        if timely or not readings:
            self._drift(stamp)
        readings, evidence = timely, self.config.evidence
        for number, source in enumerate(self.primary):
            if source.reads in readings:
                found = self._ask(source, source.locate, readings[source.reads], self.world)
                known = self._ask(source, checked_estimates, found, self.world)
                if known is not None:
                    places = merge(known, self._near, evidence.volume)
                    count = self._weight(f"primary {number}")
                    self.belief = located(self.belief, places, count, self._near, evidence)
        for number, source in enumerate(self.validation):
            if source.reads in readings and self.belief.hypotheses:
                reading, hypotheses = readings[source.reads], self.hypotheses
                given = self._ask(source, source.judge, reading, hypotheses, self.world)
                verdicts = self._ask(source, checked_verdicts, given, len(hypotheses), self.world)
                if verdicts is not None:
                    count = self._weight(f"validation {number}")
                    self.belief = judged(self.belief, verdicts, count, self._near, evidence)
        return self.belief

    def state(self) -> dict[str, Any]:
        """All that the tracker goes on from, as `json` writes it; the world model is not in it."""
        return {
            "belief": state_of_belief(self.belief),
            "way": self._way,
            "heard": dict(self._heard),
            "clock": self._clock.state(),
            "measured": self._measured,
            "silent": self._silent,
            "motion": self._motion.state(),
            "sources": [
                source.state() if isinstance(source, Remembers) else None
                for source in self._sources()
            ],
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what `state` returned, in the same world and with the same sources.

        What follows is the same to the bit. Raises `ValueError`, and changes nothing, if the
        sources are not as many or a hypothesis is in no node of the world.
        """
        if len(state["sources"]) != len(self._sources()):
            raise ValueError(
                f"state: {len(state['sources'])} sources, not the tracker's {len(self._sources())}"
            )
        belief, motion = belief_of_state(state["belief"]), Motion(float(self.config.unmeasured))
        motion.restore(state["motion"])
        for hypothesis in belief.hypotheses:
            if hypothesis.place.node not in self.world.graph:
                raise ValueError(f"state: the world has no node {hypothesis.place.node}")
        way, measured, silent = state["way"], state["measured"], state["silent"]
        heard, clock = dict(state["heard"]), Clock(float(self.config.late))
        clock.restore(state["clock"])
        self.belief, self._motion = belief, motion
        self._way, self._measured, self._silent = way, measured, silent
        self._heard, self._clock = heard, clock
        for source, own in zip(self._sources(), state["sources"], strict=True):
            if isinstance(source, Remembers):
                source.restore(own)

    def _sources(self) -> list[Any]:
        return [*self.primary, *self.tracking, *self.validation]

    def _check_names(self, call: str, readings: Iterable[str]) -> None:
        """Log, once, each kind of reading that no source takes: its name may be wrong."""
        known = {source.reads for source in self._sources()} | self._unread
        for name in readings:
            if name not in known:
                self._unread.add(name)
                _log.warning("%s: no source reads %r", call, name)

    def _advance(self, step: Step) -> None:
        self._way += travelled(step, self.config.evidence)
        if step.doubt > 0.5:
            # The robot sees another place, whatever the way: all evidence is new.
            self._heard.clear()
        self.belief = moved(self.belief, step, self.config.evidence)

    def _weight(self, name: str) -> float:
        """The power with which a source's evidence counts now."""
        before = self._heard.get(name, -math.inf)
        self._heard[name] = self._way
        return weight(self._way - before, self.config.evidence)

    def _drift(self, stamp: float | None) -> None:
        """Let volumes grow if no motion has been measured for long: the robot may have moved.

        Evidence counts as if it had gone that way.
        """
        if stamp is None or not math.isfinite(stamp):
            return
        if self._measured is None or stamp < self._measured - float(self.config.late):
            self._measured = stamp
        elapsed = stamp - self._measured
        if elapsed <= self.config.silence:
            return
        if not self._silent:
            _log.warning("no motion measured for %.1f s", elapsed)
        self._measured, self._silent = stamp, True
        far = min(float(self.config.speed) * elapsed, float(self.config.astray))
        self._way += far
        self._advance(Step(np.zeros(3), np.diag([far**2, far**2, min(far, 1.0) ** 2])))

    def _measure(
        self, source: TrackingSource, reading: Any, expected: Step | None
    ) -> tuple[bool, Step | None]:
        """Whether a source took its reading, and its step, if it has a sound one."""
        try:
            step = source.step(reading, expected)
        except Exception as error:
            _warn(source, error)
            return False, None
        return True, self._ask(source, checked_step, step)

    def _ask(self, source: Any, question: Callable[..., Any], *about: Any) -> Any:
        """The answer; None, and a line in the log, if it raises.

        None too where the first thing that is asked about is None: an earlier question failed.
        """
        try:
            return None if about[0] is None else question(*about)
        except Exception as error:
            _warn(source, error)
            return None


def _warn(source: Any, error: Exception) -> None:
    _log.warning("%s: %s: %s", type(source).__name__, type(error).__name__, error)


def motion_sources(
    world: WorldModel, T_robot_laser: Sequence[float] = (0.0, 0.0, 0.0)
) -> tuple[TrackingSource, ...]:
    """The default tracking sources, of a robot with its laser at this pose (metres, radians)."""
    wheels = WheelOdometry(T_robot_laser=T_robot_laser)
    return wheels, ScanMotion(features=world.features), ScanContinuity()
