"""Synthetic scans: what a scanner would have seen from another place (paper 2.D)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aprjax.evaluation.view import View
from aprjax.se2 import Pose, transform


def synthetic_scan(
    overview: View, T_front_overview: Pose, bearings: Float[Array, " beams"]
) -> Float[Array, " beams"]:
    """Inverse ranges (1 / m) along `bearings` (rad) in the front scan's frame; zero is unknown.

    Neighbouring hits of the overview scan are joined to surface pieces. With c(p, u) the cross
    product, a beam along u crosses the piece from p to p' where c(p, u) >= 0 > c(p', u), at the
    inverse range (c(p, u) - c(p', u)) / c(p, p'): linear in u, so no division for each beam and
    piece, and the nearest surface is the largest value. Pieces seen from behind do not count;
    walls have a back of unknown place.
    """
    xy = transform(T_front_overview, overview.xy)
    sense = jnp.sign(overview.angle_increment)
    cos, sin = sense * jnp.cos(bearings), sense * jnp.sin(bearings)
    start, stop = xy, jnp.concatenate([xy[1:], xy[:1]])
    area = sense * (start[:, 0] * stop[:, 1] - start[:, 1] * stop[:, 0])
    facing = overview.linked & (area > 1e-6)
    scale = jnp.where(facing, 1.0 / jnp.where(facing, area, 1.0), 0.0)

    # Piece after piece over all beams: on a CPU, XLA vectorises this, and not a reduction over
    # the dense beam x piece array.
    def nearest(carry, piece):
        largest, before = carry
        point, scale = piece
        after = point[0] * sin - point[1] * cos
        crossed = (before >= 0) & (after < 0)
        largest = jnp.maximum(largest, jnp.where(crossed, (before - after) * scale, 0.0))
        return (largest, after), None

    first = xy[0, 0] * sin - xy[0, 1] * cos
    (largest, _), _ = jax.lax.scan(
        nearest, (jnp.zeros_like(bearings), first), (stop, scale), unroll=8
    )
    return largest
