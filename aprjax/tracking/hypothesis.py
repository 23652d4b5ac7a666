"""Position hypotheses: volumes in the super space, and what is believed of them (paper 4.A)."""

import math
from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import threshold
from aprjax.plane import compose, compose_covariance, spread, turn_spread
from aprjax.world.parts import Place


class VolumeConfig(eqx.Module):
    """How large volumes are, and how certain a centre is at best."""

    radius: Float[Array, ""] = threshold(0.4, "metres: r_i about a centre known exactly")
    angle: Float[Array, ""] = threshold(np.radians(8), "radians: Δ_i, likewise")
    deviations: Float[Array, ""] = threshold(2.0, "standard deviations that a volume holds besides")
    largest: Float[Array, ""] = threshold(4.0, "metres: r_i at most")
    widest: Float[Array, ""] = threshold(np.radians(90), "radians: Δ_i at most")
    floor: Float[Array, ""] = threshold(0.05, "metres: deviation of a centre just confirmed")
    turn_floor: Float[Array, ""] = threshold(np.radians(1), "radians, likewise")


# Functions, not methods: each look at a method of an Equinox module makes a module of it, which
# takes longer than what these compute.


def with_floors(covariance: np.ndarray, config: VolumeConfig) -> np.ndarray:
    """A source's covariance `(3, 3)` with the floors added: the small default of the paper."""
    floor = np.square([float(config.floor), float(config.floor), float(config.turn_floor)])
    return np.asarray(covariance, float) + np.diag(floor)


def volume_size(covariance: np.ndarray, config: VolumeConfig) -> tuple[float, float]:
    """r_i in metres and Δ_i in radians about a centre of this covariance `(3, 3)`."""
    return _bounded(_wanted(covariance, config), config)


def share_held(covariance: np.ndarray, config: VolumeConfig) -> float:
    """The share of the probability about such a centre that the bounds of a volume leave in it.

    1 where neither is reached; by a normal distribution along each axis of the covariance. Of a
    heading of which nothing is known, what `widest` is of all headings stays.
    """
    wanted = _wanted(covariance, config)
    sized = _bounded(wanted, config)
    share = 1.0
    if wanted[0] > sized[0]:
        for variance in np.linalg.eigvalsh(covariance[:2, :2]):
            deviation = math.sqrt(max(variance, 0.0))
            share *= _within(sized[0], deviation) / _within(wanted[0], deviation)
    if wanted[1] > sized[1]:
        turn = turn_spread(covariance)
        least = sized[1] / math.pi
        share *= max(_within(sized[1], turn) / _within(wanted[1], turn), least)
    return share


def _wanted(covariance: np.ndarray, config: VolumeConfig) -> tuple[float, float]:
    """The size without bounds: metres, radians."""
    k = float(config.deviations)
    radius = float(config.radius) + k * spread(covariance)
    return radius, float(config.angle) + k * turn_spread(covariance)


def _bounded(wanted: tuple[float, float], config: VolumeConfig) -> tuple[float, float]:
    """The size that a volume of that wanted size has: metres, radians."""
    return min(wanted[0], float(config.largest)), min(wanted[1], float(config.widest))


def _within(bound: float, deviation: float) -> float:
    """How much of a normal distribution lies within `bound` of its mean."""
    return math.erf(bound / deviation / math.sqrt(2)) if deviation > 0 else 1.0


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """An explicit position hypothesis: the volume V_i and its probability λ_i."""

    number: int
    """Its name for as long as it lives; never given twice."""
    place: Place
    """The centre c_i: the laser's pose in the frame of the home node."""
    covariance: np.ndarray
    """`(3, 3)` of the centre in the node's frame: m², m rad, rad²."""
    radius: float
    """r_i in metres."""
    angle: float
    """Δ_i in radians."""
    probability: float
    """λ_i."""
    reference: int | None = None
    """Id of the reference scan that its centre was last seen from."""
    unconfirmed: float = 0.0
    """Metres driven since it was created or last confirmed."""
    turned: float = 0.0
    """Radians turned since then, either way."""

    def moved(self, step: "Step", config: VolumeConfig) -> "Hypothesis":
        """Carried on by a step of the robot: its volume grows, λ_i stays."""
        T = self.place.T_node_laser
        return replace(
            self.at(
                Place(self.place.node, compose(T, step.T_before_now)),
                compose_covariance(T, self.covariance, step.T_before_now, step.covariance),
                config,
            ),
            unconfirmed=self.unconfirmed + step.way,
            turned=self.turned + step.turn,
        )

    def at(self, place: Place, covariance: np.ndarray, config: VolumeConfig) -> "Hypothesis":
        """With another centre, and the volume that its covariance `(3, 3)` asks for."""
        radius, angle = volume_size(covariance, config)
        return replace(self, place=place, covariance=covariance, radius=radius, angle=angle)


@dataclass(frozen=True, eq=False)
class Step:
    """How the robot moved, as a tracking source has it."""

    T_before_now: np.ndarray
    """`(3,)`: the laser's pose now in its frame before the step; metres, radians."""
    covariance: np.ndarray
    """`(3, 3)` of it. What a source does not measure has an infinite variance."""
    doubt: float = 0.0
    """Probability that the robot moved in quite another way: that it was carried, say."""

    @classmethod
    def unmeasured(cls, doubt: float = 0.0) -> "Step":
        """No measurement of the motion at all."""
        return cls(np.zeros(3), np.diag([np.inf, np.inf, np.inf]), doubt)

    @property
    def known(self) -> np.ndarray:
        """`(3,)`: which of the numbers are measured."""
        return np.isfinite(np.diag(self.covariance))

    @property
    def way(self) -> float:
        """Metres."""
        return float(np.hypot(self.T_before_now[0], self.T_before_now[1]))

    @property
    def turn(self) -> float:
        """Radians, not negative."""
        return abs(float(self.T_before_now[2]))
