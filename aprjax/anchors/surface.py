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
from aprjax.numerics import safe_arctan2, sums, take


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


class _Samples(eqx.Module):
    """Hits on a surface near each entry, sample by sample: XLA on a CPU vectorises over entries."""

    x: Float[Array, "*samples slots"]
    """Metres from the entry's own hit; zero where not used."""
    y: Float[Array, "*samples slots"]
    used: Float[Array, "*samples slots"]
    """1 or 0."""


def surface(segments: Segments, config: SurfaceConfig) -> Surface:
    """Line fits for every entry of one segmented scan; entries that are no hit get zeros."""
    room = jnp.stack([segments.before, segments.after])
    sides = jax.vmap(_side, (None, 0, 0, None))(segments, room, jnp.array([-1, 1]), config)
    fitted = jax.vmap(_fit, (0, None))(sides, segments.xy)
    before, after = (jax.tree.map(lambda array: array[k], fitted) for k in range(2))  # noqa: B023
    hit = segments.hit.astype(jnp.float32)[None]
    itself = _Samples(jnp.zeros_like(hit), jnp.zeros_like(hit), hit)
    through = jax.tree.map(lambda two, one: jnp.concatenate([*two, one]), sides, itself)
    return Surface(before, after, _fit(through, segments.xy))


def _side(
    segments: Segments, room: Int[Array, " slots"], sign: Int[Array, ""], config: SurfaceConfig
) -> _Samples:
    """Hits to one side within the window, `(samples, slots)`."""
    x, y = segments.xy[:, 0], segments.xy[:, 1]
    index = jnp.arange(x.shape[0])

    def from_here(count):
        """To the hit so many beams on, for one count or several of each entry."""
        here_x, here_y, here = (jnp.broadcast_to(each, count.shape) for each in (x, y, index))
        there = here + sign * count
        return take(x, there) - here_x, take(y, there) - here_y

    def square(count):
        dx, dy = from_here(count)
        return dx * dx + dy * dy

    window = jnp.maximum(config.window**2, config.spacings**2 * square(jnp.minimum(room, 1)))

    # Chords grow along a surface, so the window's last beam is found by bisection; but not
    # right around a room, so that an eighth of a turn is the most that is looked at.
    eighth = jnp.ceil(0.25 * np.pi / jnp.abs(segments.angle_increment))
    slots = x.shape[0]
    room = jnp.minimum(room, jnp.minimum(eighth, slots).astype(jnp.int32))
    bits = (slots - 1).bit_length()

    def halve(step, count):
        longer = jnp.minimum(count + (1 << (bits - 1 - step)), room)
        return jnp.where(square(longer) <= window, longer, count)

    count = jax.lax.fori_loop(jnp.int32(0), bits, halve, jnp.zeros_like(room))

    k = jnp.arange(1, config.samples + 1)[:, None]
    offset = -(-k * count[None] // config.samples)
    earlier = -(-(k - 1) * count[None] // config.samples)
    used = (offset > earlier) & segments.hit[None]
    dx, dy = from_here(offset)
    return _Samples(jnp.where(used, dx, 0.0), jnp.where(used, dy, 0.0), used.astype(jnp.float32))


def _fit(samples: _Samples, origin: Float[Array, "slots 2"]) -> Face:
    """Total least squares lines through the samples of each entry, whose hit is its `origin`."""
    x, y = samples.x, samples.y
    count, *moments = sums(samples.used, x, y, x * x, y * y, x * y)
    share = 1.0 / jnp.maximum(count, 1.0)
    mean_x, mean_y, xx, yy, xy = (share * moment for moment in moments)
    xx, yy, xy = xx - mean_x**2, yy - mean_y**2, xy - mean_x * mean_y
    half = jnp.sqrt(jnp.maximum(0.25 * (xx - yy) ** 2 + xy**2, 1e-12))
    mean = 0.5 * (xx + yy)
    return Face(
        centre=origin + jnp.stack([mean_x, mean_y], axis=-1),
        direction=0.5 * safe_arctan2(2 * xy, xx - yy),
        count=count,
        spread=jnp.sqrt(jnp.maximum(mean + half, 1e-12)),
        rms=jnp.sqrt(jnp.maximum(mean - half, 1e-12)),
    )
