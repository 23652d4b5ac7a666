"""Synthetic scans: what a scanner would have seen from another place (paper 2.D)."""

import jax
import jax.numpy as jnp
import numpy as np
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
    in_front = overview.linked & (area > 1e-6)
    scale = jnp.where(in_front, 1.0 / jnp.where(in_front, area, 1.0), 0.0)

    # Group after group of pieces over all beams: on a CPU, XLA vectorises this, and not a reduction
    # over the dense beam x piece array.
    def nearest(largest, group):
        points, scale = group
        side = [points[k, 0] * sin - points[k, 1] * cos for k in range(_GROUP + 1)]
        for k in range(_GROUP):
            crossed = (side[k] >= 0) & (side[k + 1] < 0)
            beyond = jnp.where(crossed, (side[k] - side[k + 1]) * scale[k], 0.0)
            largest = jnp.maximum(largest, beyond)
        return largest, None

    # With the first point of the next group at its end, a group needs nothing of the one before.
    groups = -(-xy.shape[0] // _GROUP)
    point = _GROUP * np.arange(groups)[:, None] + np.arange(_GROUP + 1)
    pieces = jnp.pad(scale, (0, groups * _GROUP - xy.shape[0])).reshape(groups, _GROUP)
    return jax.lax.scan(nearest, jnp.zeros_like(bearings), (xy[point % xy.shape[0]], pieces))[0]


_GROUP = 8
"""Surface pieces in one round."""
