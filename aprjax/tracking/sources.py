"""What the tracker hears from: three kinds of sources (paper 4.A), each a method or two.

Every source names the input it `reads`, such as "scan", "odometry" or "image"; the tracker hands
it what it is given under that name. A source may keep a state of its own; if it has methods
`state` and `restore`, that is saved and restored with the tracker.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from aprjax.tracking.hypothesis import Hypothesis, Step
from aprjax.world.model import WorldModel
from aprjax.world.parts import Place


@dataclass(frozen=True, eq=False)
class Estimate:
    """Where the robot may be, by a source that knows of no hypothesis."""

    place: Place
    """The laser's pose in the home node of what was recognized."""
    covariance: np.ndarray
    """`(3, 3)` in the node's frame: m², m rad, rad²."""
    probability: float
    """Of being right, in [0, 1], as if nothing else were known."""
    reference: int | None = None
    """Id of the reference scan it was recognized by, if it was one."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a validation source says of one hypothesis."""

    likelihood: float
    """How much likelier what it sensed is there than anywhere else: over 1 confirms, under 1
    weakens, 1 says nothing."""
    place: Place | None = None
    """A better centre, if it has one."""
    covariance: np.ndarray | None = None
    """`(3, 3)` of that, in its node's frame."""
    reference: int | None = None
    """Id of the reference scan it is seen from, if it is one."""


class PrimarySource(Protocol):
    """A global localization technique: it creates hypotheses and confirms them."""

    reads: str

    def locate(self, reading: Any, world: WorldModel) -> Sequence[Estimate]:
        """All alternatives, whatever was believed before; none if nothing is recognized."""
        ...


class TrackingSource(Protocol):
    """A sensor of relative motion: it moves hypotheses and makes their volumes grow."""

    reads: str

    def step(self, reading: Any, expected: Step | None) -> Step | None:
        """The motion since its last reading; None where it cannot tell, as from the first one.

        A source that raises has not taken the reading: its next step goes from the one before.
        `expected` is what the sources before it measured of the same step, if any did.
        """
        ...


class ValidationSource(Protocol):
    """A sensor that can tell how well a place fits: it confirms or weakens, and creates nothing."""

    reads: str

    def judge(
        self, reading: Any, hypotheses: Sequence[Hypothesis], world: WorldModel
    ) -> Sequence[Verdict]:
        """A verdict on each hypothesis, in their order."""
        ...


@runtime_checkable
class Remembers(Protocol):
    """A source with a state that is saved with the tracker's."""

    def state(self) -> Any:
        """Plain numbers, strings, lists and dictionaries."""
        ...

    def restore(self, state: Any) -> None:
        """Go on from what `state` returned."""
        ...
