"""Motions of the plane on the host, and how their errors add up.

Poses are those of `se2`, in NumPy and float64: a map may lie far from its frame's origin, and poses
are composed by the hundred along it. The covariance `(3, 3)` of a pose `T_a_b` is that of its three
numbers as they stand, `x, y` along the axes of frame a: m², m rad, rad².
"""

import math

import numpy as np


def wrap(angle: np.ndarray) -> np.ndarray:
    """Radians, shifted by whole turns into [-π, π)."""
    return np.mod(angle + np.pi, 2 * np.pi) - np.pi


def transform(T_a_b: np.ndarray, xy_b: np.ndarray) -> np.ndarray:
    """Points `(..., 2)` of frame b in frame a, for poses `(..., 3)`; leading axes broadcast."""
    cos, sin = np.cos(T_a_b[..., 2]), np.sin(T_a_b[..., 2])
    x, y = xy_b[..., 0], xy_b[..., 1]
    return T_a_b[..., :2] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def compose(T_a_b: np.ndarray, T_b_c: np.ndarray) -> np.ndarray:
    """`T_a_c` of poses `(..., 3)`; leading axes broadcast."""
    xy = transform(T_a_b, T_b_c[..., :2])
    theta = wrap(T_a_b[..., 2] + T_b_c[..., 2])
    return np.concatenate([xy, theta[..., None]], axis=-1)


def relative(T_a_b: np.ndarray, T_a_c: np.ndarray) -> np.ndarray:
    """`T_b_c` of poses `(..., 3)` in one frame; leading axes broadcast."""
    cos, sin = np.cos(T_a_b[..., 2]), np.sin(T_a_b[..., 2])
    x, y, theta = np.moveaxis(T_a_c - T_a_b, -1, 0)
    return np.stack([cos * x + sin * y, cos * y - sin * x, wrap(theta)], axis=-1)


def inverse(T_a_b: np.ndarray) -> np.ndarray:
    """`T_b_a` of poses `(..., 3)`."""
    return relative(T_a_b, np.zeros(3))


def distance(T: np.ndarray) -> np.ndarray:
    """Metres between the origins of the two frames of poses `(..., 3)`."""
    return np.hypot(T[..., 0], T[..., 1])


def compose_covariance(
    T_a_b: np.ndarray, cov_a_b: np.ndarray, T_b_c: np.ndarray, cov_b_c: np.ndarray
) -> np.ndarray:
    """The covariance of `compose(T_a_b, T_b_c)` for single poses with independent errors."""
    cos, sin = math.cos(T_a_b[2]), math.sin(T_a_b[2])
    x, y = cos * T_b_c[0] - sin * T_b_c[1], sin * T_b_c[0] + cos * T_b_c[1]
    of_first = np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])
    of_second = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return of_first @ cov_a_b @ of_first.T + of_second @ cov_b_c @ of_second.T


def inverse_covariance(T_a_b: np.ndarray, cov_a_b: np.ndarray) -> np.ndarray:
    """The covariance of `inverse(T_a_b)` for a single pose."""
    cos, sin = math.cos(T_a_b[2]), math.sin(T_a_b[2])
    x, y = T_a_b[0], T_a_b[1]
    change = np.array(
        [[-cos, -sin, sin * x - cos * y], [sin, -cos, cos * x + sin * y], [0.0, 0.0, -1.0]]
    )
    return change @ cov_a_b @ change.T


def spread(covariance: np.ndarray) -> float:
    """Standard deviation of the place in metres, in all directions together."""
    return math.sqrt(max(covariance[0, 0] + covariance[1, 1], 0.0))


def turn_spread(covariance: np.ndarray) -> float:
    """Standard deviation of the heading in radians."""
    return math.sqrt(max(covariance[2, 2], 0.0))
