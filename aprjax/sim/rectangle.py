"""Rectangles on the host, as plans are made of: `(2, 2)`, the low and the high corner in metres."""

import numpy as np

from aprjax.plane import transform


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
