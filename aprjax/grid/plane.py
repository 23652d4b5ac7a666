"""Rigid motions of the plane in NumPy's float64: a map may lie far from its frame's origin."""

import numpy as np


def transform(T_a_b: np.ndarray, xy_b: np.ndarray) -> np.ndarray:
    """Points `(n, 2)` given in frame b, in frame a."""
    cos, sin = np.cos(T_a_b[2]), np.sin(T_a_b[2])
    return T_a_b[:2] + xy_b @ np.array([[cos, sin], [-sin, cos]])


def compose(T_a_b: np.ndarray, T_b_c: np.ndarray) -> np.ndarray:
    """`T_a_c` `(n, 3)` of one `T_a_b` `(3,)` and many `T_b_c` `(n, 3)`."""
    return np.column_stack([transform(T_a_b, T_b_c[:, :2]), _wrap(T_a_b[2] + T_b_c[:, 2])])


def inverse(T_a_b: np.ndarray) -> np.ndarray:
    """`T_b_a` `(3,)`."""
    cos, sin = np.cos(T_a_b[2]), np.sin(T_a_b[2])
    x, y, theta = T_a_b
    return np.array([-cos * x - sin * y, sin * x - cos * y, -theta])


def _wrap(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi
