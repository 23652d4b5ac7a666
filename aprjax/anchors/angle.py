"""Angle anchors: convex or concave edges of which both faces are visible (paper 2.A)."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aprjax.anchors.candidates import Candidates, Kind
from aprjax.anchors.segment import Segments
from aprjax.anchors.surface import Face, Surface
from aprjax.configuration import threshold
from aprjax.numerics import safe_norm, wrap


class AngleConfig(eqx.Module):
    """What counts as a corner."""

    min_angle: Float[Array, ""] = threshold(0.15, "radians by which the surface must turn")
    max_angle: Float[Array, ""] = threshold(2.6, "radians; a sharper turn is a thin object's end")
    min_spread: Float[Array, ""] = threshold(0.03, "metres: standard deviation along each face")
    max_rms: Float[Array, ""] = threshold(0.05, "metres: standard deviation across each face")
    max_offset: Float[Array, ""] = threshold(
        0.15, "metres between the hit and the intersection", least=0.001
    )
    weight: Float[Array, ""] = threshold(1.0, "salience of a right angle between straight faces")


def angles(segments: Segments, surface: Surface, config: AngleConfig) -> Candidates:
    """One candidate for every hit on a large part; the choice among neighbours comes later.

    The corner is the intersection of the lines fitted to both faces, which is finer than the
    spacing of the beams.
    """
    before, after = surface.before, surface.after
    turn = wrap(_heading(after, segments, 1) - _heading(before, segments, -1))
    corner, sine = intersection(before.centre, before.direction, after.centre, after.direction)
    rms = jnp.maximum(before.rms, after.rms)
    straight = jnp.exp(-0.5 * (rms / config.max_rms) ** 2)
    offset = safe_norm(corner - segments.xy)
    valid = (
        segments.large
        & (jnp.minimum(before.count, after.count) >= 3)
        & (jnp.minimum(before.spread, after.spread) >= config.min_spread)
        & (rms <= config.max_rms)
        & (jnp.abs(turn) >= config.min_angle)
        & (jnp.abs(turn) <= config.max_angle)
        & (offset <= config.max_offset)
    )
    nearness = 1.0 - 0.5 * offset / config.max_offset
    return Candidates(
        xy=corner,
        kind=jnp.full(valid.shape, Kind.ANGLE.value, jnp.int32),
        salience=config.weight * jnp.abs(sine) * straight * nearness,
        valid=valid,
    )


def _heading(face: Face, segments: Segments, sign: int) -> Float[Array, " slots"]:
    """The face's direction in the sense of the sweep, in radians."""
    along = sign * (face.centre - segments.xy)
    forward = along[:, 0] * jnp.cos(face.direction) + along[:, 1] * jnp.sin(face.direction)
    return jnp.where(forward >= 0, face.direction, face.direction + np.pi)


def intersection(
    point_a: Float[Array, "*batch 2"],
    direction_a: Float[Array, "*batch"],
    point_b: Float[Array, "*batch 2"],
    direction_b: Float[Array, "*batch"],
) -> tuple[Float[Array, "*batch 2"], Float[Array, "*batch"]]:
    """Where two lines, each a point and a direction in radians, meet; and the sine between them.

    Parallel lines meet at `point_a`, with a sine of zero.
    """
    sine = jnp.sin(direction_b - direction_a)
    gap = point_b - point_a
    across = gap[..., 0] * jnp.sin(direction_b) - gap[..., 1] * jnp.cos(direction_b)
    parallel = jnp.abs(sine) < 1e-6
    along = jnp.where(parallel, 0.0, across / jnp.where(parallel, 1.0, sine))
    unit = jnp.stack([jnp.cos(direction_a), jnp.sin(direction_a)], axis=-1)
    return point_a + along[..., None] * unit, sine
