"""Wheel odometry and a gyro: what the robot believes of its own motion."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from aprjax.configuration import threshold
from aprjax.plane import compose, relative


class OdometryConfig(eqx.Module):
    """Errors of wheels and gyro.

    Systematic ones are drawn once for a run, normally distributed with these sigmas, as wheels
    wear: the robot keeps its wheels. Random ones are drawn for each step, their variances
    proportional to the way or the turn, so that it does not matter how often one looks.
    """

    scale: Float[Array, ""] = threshold(0.02, "of the way: wheel radii")
    turn_scale: Float[Array, ""] = threshold(0.02, "of the turn: track width")
    curvature: Float[Array, ""] = threshold(0.01, "radians/m: one wheel larger than the other")
    slip: Float[Array, ""] = threshold(0.02, "metres along the way after 1 m")
    sideways: Float[Array, ""] = threshold(0.01, "metres across the way after 1 m")
    heading: Float[Array, ""] = threshold(0.02, "radians after 1 m")
    turning: Float[Array, ""] = threshold(0.03, "radians after a turn by 1 rad")
    gyro_bias: Float[Array, ""] = threshold(0.0005, "radians/s: systematic")
    gyro_noise: Float[Array, ""] = threshold(0.001, "radians after 1 s")

    def __check_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name}: {getattr(self, name)} is not in [0, ∞)")

    @classmethod
    def exact(cls) -> "OdometryConfig":
        """No error at all."""
        return cls(**dict.fromkeys(cls.__dataclass_fields__, 0.0))  # pyright: ignore[reportArgumentType]


def odometry(
    seed: int, T_world_robot: np.ndarray, stamps: np.ndarray, config: OdometryConfig | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Odometry poses `(N, 3)` and gyro headings `(N,)` along a way of poses `T_world_robot`.

    Odometry starts at (0, 0, 0) in a frame of its own, in metres and radians in [-π, π); the
    gyro starts at 0 and is not wrapped. `stamps` `(N,)` are seconds. Raises `ValueError` if the
    shapes do not fit.
    """
    config = OdometryConfig() if config is None else config
    poses, stamps = np.asarray(T_world_robot, float), np.asarray(stamps, float)
    if poses.ndim != 2 or poses.shape[1] != 3 or len(poses) == 0:
        raise ValueError(f"T_world_robot: shape {poses.shape} is not (poses, 3) with one at least")
    if stamps.shape != poses.shape[:1]:
        raise ValueError(f"stamps: shape {stamps.shape} does not fit {len(poses)} poses")
    rng = np.random.default_rng(seed)
    scale, turn_scale, curvature, bias = rng.normal(
        0, [config.scale, config.turn_scale, config.curvature, config.gyro_bias]
    )
    steps = relative(poses[:-1], poses[1:])
    way, turn = np.hypot(steps[:, 0], steps[:, 1]), steps[:, 2]
    along, across, roll, pivot, drift = rng.normal(size=(5, len(steps)))

    believed = steps.copy()
    believed[:, :2] *= 1 + scale
    believed[:, 0] += config.slip * np.sqrt(way) * along
    believed[:, 1] += config.sideways * np.sqrt(way) * across
    believed[:, 2] = (1 + turn_scale) * turn + curvature * way
    believed[:, 2] += config.heading * np.sqrt(way) * roll
    believed[:, 2] += config.turning * np.sqrt(np.abs(turn)) * pivot
    T_odom_robot = np.zeros_like(poses)
    for i, step in enumerate(believed):
        T_odom_robot[i + 1] = compose(T_odom_robot[i], step)

    seconds = np.diff(stamps)
    measured = turn + bias * seconds + config.gyro_noise * np.sqrt(seconds) * drift
    return T_odom_robot, np.concatenate([[0.0], np.cumsum(measured)])
