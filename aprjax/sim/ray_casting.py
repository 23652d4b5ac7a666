"""Exact ray casting: the distance from a scanner to the nearest surface along each beam."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aprjax.se2 import Pose, rotate
from aprjax.sim.world import World

_TOUCH = 1e-6  # radians between a ray and a segment's end that it counts as hitting


def cast(
    world: World, T_world_laser: Pose, bearings: Float[Array, " rays"]
) -> Float[Array, " rays"]:
    """Metres from the laser to the nearest surface along each bearing, +inf where there is none.

    Bearings are in radians, relative to the laser's heading. Of a circle, a ray from outside hits
    the near side, one from inside the far side. A segment seen edge-on is hit at its nearer end.
    For one pose; `vmap` serves more.
    """
    ray = rotate(jnp.stack([jnp.cos(bearings), jnp.sin(bearings)], axis=-1), T_world_laser[2])
    position = T_world_laser[:2]
    real = jnp.any(world.segments[:, 0] != world.segments[:, 1], axis=-1)
    # Comparisons with NaN are false: padding is never hit.
    ends = jnp.where(real[:, None, None], world.segments - position[None, None], jnp.nan)
    circles = jnp.concatenate([world.circles[:, :2] - position[None], world.circles[:, 2:]], axis=1)

    def along_and_across(xy):
        return ray[:, 0] * xy[0] + ray[:, 1] * xy[1], ray[:, 0] * xy[1] - ray[:, 1] * xy[0]

    def nearer_segment(nearest, ends):
        along, across = along_and_across(ends[0])
        along_end, across_end = along_and_across(ends[1])
        share = across / (across - across_end)
        met = along + share * (along_end - along)
        crossed = ((across > 0) != (across_end > 0)) & (met > 0)
        nearest = jnp.minimum(nearest, jnp.where(crossed, met, jnp.inf))
        # No ray slips between two segments that share an end, whichever way rounding goes.
        at_start = jnp.abs(across) < _TOUCH * along
        nearest = jnp.minimum(nearest, jnp.where(at_start, along, jnp.inf))
        at_end = jnp.abs(across_end) < _TOUCH * along_end
        return jnp.minimum(nearest, jnp.where(at_end, along_end, jnp.inf)), None

    def nearer_circle(nearest, circle):
        along, across = along_and_across(circle)
        square = circle[2] * circle[2] - across * across
        half_chord = jnp.sqrt(jnp.maximum(square, 0.0))
        met = jnp.where(along > half_chord, along - half_chord, along + half_chord)
        hit = (square > 0) & (met > 0)
        return jnp.minimum(nearest, jnp.where(hit, met, jnp.inf)), None

    # Surface after surface over all rays: on a CPU, XLA vectorises this, and not a reduction over
    # a dense ray x surface array, and no such array is ever written.
    nothing = jnp.full_like(bearings, jnp.inf)
    nearest, _ = jax.lax.scan(nearer_segment, nothing, ends, unroll=4)
    nearest, _ = jax.lax.scan(nearer_circle, nearest, circles, unroll=4)
    return nearest
