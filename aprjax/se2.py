"""Rigid motions of the plane, SE(2).

A pose `T_a_b` is a float array `(..., 3)` holding `x, y` in metres and `theta` in radians,
counter-clockwise: the pose of frame b in frame a. It maps the coordinates of a point in b to
those in a, and `compose(T_a_b, T_b_c)` is `T_a_c`.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from aprjax.numerics import wrap

Pose = Float[Array, "*batch 3"]


def rotate(
    vector: Float[Array, "*batch 2"], angle: Float[Array, "*#batch"]
) -> Float[Array, "*batch 2"]:
    """Vectors turned by `angle` radians."""
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    x, y = vector[..., 0], vector[..., 1]
    return jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def compose(T_a_b: Pose, T_b_c: Pose) -> Pose:
    """`T_a_c`, its angle in [-π, π)."""
    xy = T_a_b[..., :2] + rotate(T_b_c[..., :2], T_a_b[..., 2])
    return jnp.concatenate([xy, wrap(T_a_b[..., 2:] + T_b_c[..., 2:])], axis=-1)


def inverse(T_a_b: Pose) -> Pose:
    """`T_b_a`, its angle in [-π, π)."""
    xy = -rotate(T_a_b[..., :2], -T_a_b[..., 2])
    return jnp.concatenate([xy, wrap(-T_a_b[..., 2:])], axis=-1)


def transform(
    T_a_b: Pose, xy_b: Float[Array, "*batch points 2"]
) -> Float[Array, "*batch points 2"]:
    """Points given in frame b, in frame a."""
    return T_a_b[..., None, :2] + rotate(xy_b, T_a_b[..., 2, None])
