"""Tracking sources: wheel odometry with a motion model, and a gyroscope that knows the heading."""

import logging
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import threshold
from aprjax.plane import compose, compose_covariance, distance, inverse, relative, wrap
from aprjax.tracking.hypothesis import Step

_log = logging.getLogger(__name__)

_EXACT = np.zeros((3, 3))


class OdometryConfig(eqx.Module):
    """The errors of wheel odometry, in standard deviations."""

    slip: Float[Array, ""] = threshold(0.01, "metres: of a step, at rest")
    slip_per_metre: Float[Array, ""] = threshold(0.08, "metres that a metre of way adds")
    slip_per_turn: Float[Array, ""] = threshold(0.04, "metres that a radian adds")
    turn: Float[Array, ""] = threshold(np.radians(0.3), "radians: of a step, at rest")
    turn_per_metre: Float[Array, ""] = threshold(0.15, "radians that a metre of way adds")
    turn_per_turn: Float[Array, ""] = threshold(0.3, "radians that a radian adds")
    jump: Float[Array, ""] = threshold(5.0, "metres of one step that no wheels can have made")


class WheelOdometry:
    """Steps from integrated wheel odometry.

    A reading is the robot's pose `(3,)` in any frame that stays the same, metres and radians. The
    deviations of a step grow with its way and its turn, so that a way in few long steps and the
    same in many short ones leave about the same volumes. A step over `jump` is the odometry
    starting anew: it is left out, and the next step goes from there. A laser that does not sit
    between the wheels swings when the robot turns: `T_robot_laser` says where it is.
    """

    reads = "odometry"

    def __init__(
        self, config: OdometryConfig | None = None, T_robot_laser: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> None:
        """`T_robot_laser` is the laser's pose on the robot, in metres and radians.

        Raises `ValueError` unless it is three finite numbers.
        """
        self.config = OdometryConfig() if config is None else config
        self._T_robot_laser = _finite(T_robot_laser, 3, "T_robot_laser")
        self._last: np.ndarray | None = None

    def step(self, reading: Any, expected: Step | None) -> Step | None:
        """The motion since the last pose. Raises `ValueError` unless it is three finite numbers."""
        pose = _finite(reading, 3, "odometry")
        last, self._last = self._last, pose
        if last is None:
            return None
        T = relative(last, pose)
        if distance(T) > self.config.jump:
            _log.warning("odometry: a step of %.1f m, taken for a new start", distance(T))
            return None
        laser, covariance = self._T_robot_laser, self.covariance(T)
        if not laser.any():
            return Step(T, covariance)
        moved = compose(T, laser)
        at_laser = compose_covariance(T, covariance, laser, _EXACT)
        back = inverse(laser)
        return Step(compose(back, moved), compose_covariance(back, _EXACT, moved, at_laser))

    def covariance(self, T_before_now: np.ndarray) -> np.ndarray:
        """The motion model: `(3, 3)` of a step `(3,)`.

        An error of the heading that comes about evenly along a way turns what is left of it.
        """
        c = self.config
        way, turn = float(distance(T_before_now)), abs(float(T_before_now[2]))
        if way == 0.0 and turn == 0.0:
            return np.zeros((3, 3))
        # Variances of parts of a way add up to those of the whole; squares of deviations do not.
        place = float(c.slip) ** 2 + (
            float(c.slip_per_metre) ** 2 * way + float(c.slip_per_turn) ** 2 * turn
        )
        heading = float(c.turn) ** 2 + (
            float(c.turn_per_metre) ** 2 * way + float(c.turn_per_turn) ** 2 * turn
        )
        aside = np.array([-T_before_now[1], T_before_now[0]])
        covariance = np.diag([place, place, heading])
        covariance[:2, :2] += heading / 3.0 * np.outer(aside, aside)
        covariance[:2, 2] = covariance[2, :2] = heading / 2.0 * aside
        return covariance

    def state(self) -> list[float] | None:
        """The last pose."""
        return None if self._last is None else self._last.tolist()

    def restore(self, state: Sequence[float] | None) -> None:
        """Go on from a pose that `state` returned."""
        self._last = None if state is None else np.array(state, float)


class Gyro:
    """Turns from an integrated gyroscope.

    A reading is the heading in radians, in any frame that stays the same; whole turns do not
    matter. It measures no way, so that alone it can only turn hypotheses on the spot.
    """

    reads = "gyro"

    def __init__(self, drift: float = 0.002, scale: float = 0.01) -> None:
        """`drift` is the deviation of a step in radians, `scale` what a radian of turn adds."""
        self.drift, self.scale = drift, scale
        self._last: float | None = None

    def step(self, reading: Any, expected: Step | None) -> Step | None:
        """The turn since the last heading. Raises `ValueError` unless it is a finite number."""
        heading = float(_finite(np.reshape(reading, (-1,)), 1, "gyro")[0])
        last, self._last = self._last, heading
        if last is None:
            return None
        turn = float(wrap(np.asarray(heading - last)))
        variance = self.drift**2 + (self.scale * turn) ** 2
        return Step(np.array([0.0, 0.0, turn]), np.diag([np.inf, np.inf, variance]))

    def state(self) -> float | None:
        """The last heading."""
        return self._last

    def restore(self, state: float | None) -> None:
        """Go on from a heading that `state` returned."""
        self._last = state


def _finite(reading: Any, size: int, name: str) -> np.ndarray:
    values = np.asarray(reading, float)
    if values.shape != (size,) or not np.all(np.isfinite(values)):
        raise ValueError(f"{name}: {reading!r} is not {size} finite numbers")
    return values
