"""Frames and rectangles on the host: plans and drives are made in NumPy, on no device.

Poses are those of `se2`; a rectangle `(2, 2)` holds its low and its high corner in metres.
"""

import numpy as np


def wrap(angle: np.ndarray) -> np.ndarray:
    """Radians, shifted by whole turns into [-π, π)."""
    return np.mod(angle + np.pi, 2 * np.pi) - np.pi


def transform(T_a_b: np.ndarray, xy_b: np.ndarray) -> np.ndarray:
    """Points `(..., 2)` given in frame b, in frame a; `T_a_b` is one pose `(3,)`."""
    cos, sin = np.cos(T_a_b[2]), np.sin(T_a_b[2])
    x, y = xy_b[..., 0], xy_b[..., 1]
    return T_a_b[:2] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def compose(T_a_b: np.ndarray, T_b_c: np.ndarray) -> np.ndarray:
    """`T_a_c` for one pose `T_a_b` `(3,)` and poses `T_b_c` `(..., 3)`, angles in [-π, π)."""
    xy = transform(T_a_b, T_b_c[..., :2])
    return np.concatenate([xy, wrap(T_a_b[2] + T_b_c[..., 2:])], axis=-1)


def relative(T_a_b: np.ndarray, T_a_c: np.ndarray) -> np.ndarray:
    """`T_b_c` for poses `(..., 3)` of b and c in one frame, pair by pair, angles in [-π, π)."""
    cos, sin = np.cos(T_a_b[..., 2]), np.sin(T_a_b[..., 2])
    x, y, theta = np.moveaxis(T_a_c - T_a_b, -1, 0)
    return np.stack([cos * x + sin * y, cos * y - sin * x, wrap(theta)], axis=-1)


def transform_rectangle(T_a_b: np.ndarray, rectangle: np.ndarray) -> np.ndarray:
    """The smallest rectangle of frame a that holds one of frame b."""
    low, high = rectangle
    corners = transform(T_a_b, np.array([low, (high[0], low[1]), high, (low[0], high[1])]))
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def overlap(one: np.ndarray, other: np.ndarray) -> np.ndarray | None:
    """What two rectangles share, or None where that is no area."""
    both = np.stack([np.maximum(one[0], other[0]), np.minimum(one[1], other[1])])
    return both if np.all(both[0] < both[1]) else None


def grown(rectangle: np.ndarray, margin: float) -> np.ndarray:
    """The rectangle with `margin` metres more on every side, less where it is negative."""
    return rectangle + np.array([[-margin], [margin]])


def closed(corners: np.ndarray) -> np.ndarray:
    """Sides `(K, 2, 2)` of the polygon with `corners` `(K, 2)`."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def box(width: float, depth: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    """Sides `(4, 2, 2)` of a box around (x, y)."""
    corners = np.array([(-width, -depth), (width, -depth), (width, depth), (-width, depth)]) / 2
    return closed(corners + np.array([x, y]))
