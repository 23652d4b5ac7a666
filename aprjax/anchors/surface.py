"""The course of the surface to both sides of every hit: lines fitted within a fixed distance.

A window in metres, not in beams, sees the same stretch of wall from every viewpoint. Only where
hits lie too far apart for a line does it grow with their spacing.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aprjax.anchors.segment import Segments
from aprjax.configuration import capacity, threshold
from aprjax.numerics import safe_arctan2


class SurfaceConfig(eqx.Module):
    """The stretch of surface that is looked at around each hit."""

    window: Float[Array, ""] = threshold(0.5, "metres to each side")
    spacings: Float[Array, ""] = threshold(
        3.2, "window in spacings of the hits, where that is more"
    )
    samples: int = capacity(10, "hits used of each side, evenly spread")


class Face(eqx.Module):
    """Lines through the hits to one side of each hit, or around it."""

    centre: Float[Array, "slots 2"]
    """Metres."""
    direction: Float[Array, " slots"]
    """Radians in [-π / 2, π / 2): a line has no sense."""
    count: Float[Array, " slots"]
    """Hits used."""
    spread: Float[Array, " slots"]
    """Standard deviation along the line in metres."""
    rms: Float[Array, " slots"]
    """Standard deviation across the line in metres."""


class Surface(eqx.Module):
    """The surface before and after each hit in the order of the sweep, and through it."""

    before: Face
    after: Face
    through: Face


def surface(segments: Segments, config: SurfaceConfig) -> Surface:
    """Line fits for every entry of one segmented scan; entries that are no hit get zeros."""
    room = jnp.stack([segments.before, segments.after])
    before, after = jax.vmap(_side, (None, 0, 0, None))(segments, room, jnp.array([-1, 1]), config)
    middle = jnp.concatenate(
        [segments.xy[:, None], jnp.ones_like(segments.xy[:, None, :1])], axis=-1
    )
    middle = jnp.where(segments.hit[:, None, None], middle, 0.0)
    through = jnp.concatenate([before, middle, after], axis=1)
    sides = jax.vmap(_fit, (0, None))(jnp.stack([before, after]), segments.xy)
    before, after = (jax.tree.map(lambda array: array[k], sides) for k in range(2))  # noqa: B023
    return Surface(before, after, _fit(through, segments.xy))


def _side(
    segments: Segments, room: Int[Array, " slots"], sign: Int[Array, ""], config: SurfaceConfig
) -> Float[Array, "slots samples 3"]:
    """Hits to one side within the window: x, y and weight 1, or zeros."""
    index = jnp.arange(segments.xy.shape[0])

    def square(count):
        chord = segments.xy[index + sign * count] - segments.xy
        return jnp.sum(chord * chord, axis=-1)

    window = jnp.maximum(config.window**2, config.spacings**2 * square(jnp.minimum(room, 1)))

    # Chords grow along a surface, so the window's last beam is found by bisection; but not
    # right around a room, so that an eighth of a turn is the most that is looked at.
    eighth = jnp.ceil(0.25 * np.pi / jnp.abs(segments.angle_increment))
    slots = segments.xy.shape[0]
    room = jnp.minimum(room, jnp.minimum(eighth, slots).astype(jnp.int32))
    bits = (slots // 2).bit_length()

    def halve(step, count):
        longer = jnp.minimum(count + (1 << (bits - 1 - step)), room)
        return jnp.where(square(longer) <= window, longer, count)

    count = jax.lax.fori_loop(jnp.int32(0), bits, halve, jnp.zeros_like(room))

    k = jnp.arange(1, config.samples + 1)[None, :]
    offset = -(-k * count[:, None] // config.samples)
    earlier = -(-(k - 1) * count[:, None] // config.samples)
    used = (offset > earlier) & segments.hit[:, None]
    xy = segments.xy[index[:, None] + sign * offset]
    points = jnp.concatenate([xy, jnp.ones_like(xy[..., :1])], axis=-1)
    return jnp.where(used[..., None], points, 0.0)


def _fit(points: Float[Array, "slots samples 3"], origin: Float[Array, "slots 2"]) -> Face:
    """Total least squares lines through weighted points, from moments about `origin`."""
    weight = points[..., 2]
    x, y = jnp.moveaxis((points[..., :2] - origin[:, None]) * weight[..., None], -1, 0)
    count = jnp.sum(weight, axis=-1)
    share = 1.0 / jnp.maximum(count, 1.0)
    mean_x, mean_y = jnp.sum(x, axis=-1) * share, jnp.sum(y, axis=-1) * share
    xx = jnp.sum(x * x, axis=-1) * share - mean_x**2
    yy = jnp.sum(y * y, axis=-1) * share - mean_y**2
    xy = jnp.sum(x * y, axis=-1) * share - mean_x * mean_y
    half = jnp.sqrt(jnp.maximum(0.25 * (xx - yy) ** 2 + xy**2, 1e-12))
    mean = 0.5 * (xx + yy)
    return Face(
        centre=origin + jnp.stack([mean_x, mean_y], axis=-1),
        direction=0.5 * safe_arctan2(2 * xy, xx - yy),
        count=count,
        spread=jnp.sqrt(jnp.maximum(mean + half, 1e-12)),
        rms=jnp.sqrt(jnp.maximum(mean - half, 1e-12)),
    )
