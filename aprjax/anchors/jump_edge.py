"""Jump edge anchors: convex edges of which one face is visible (paper 2.A).

The near end of a range discontinuity. Where a part ends because a nearer object hides the rest
of it, because the field of view ends, or because the next beam says nothing, there is no edge.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.anchors.candidates import Candidates, Kind
from aprjax.anchors.segment import Segments
from aprjax.configuration import threshold
from aprjax.numerics import safe_norm


class JumpEdgeConfig(eqx.Module):
    """What counts as a jump."""

    jump: Float[Array, ""] = threshold(0.2, "metres by which the range grows past the edge")
    relative: Float[Array, ""] = threshold(0.05, "the same, per metre of range")
    weight: Float[Array, ""] = threshold(0.6, "salience of a jump of 1 m or more")


def jump_edges(segments: Segments, config: JumpEdgeConfig) -> Candidates:
    """One candidate for either end of every large part: `2 * slots` of them, most not valid.

    The edge lies between the last beam that hit and the first that passed, so the anchor is put
    half a beam's spacing beyond the last hit, along the surface.
    """
    before = _ends(segments, segments.previous, segments.before == 0, segments.after, 1, config)
    after = _ends(segments, segments.next, segments.after == 0, segments.before, -1, config)
    return Candidates.join(before, after)


def _ends(
    segments: Segments,
    beyond: Int[Array, " slots"],
    ends: Bool[Array, " slots"],
    room: Int[Array, " slots"],
    inward: int,
    config: JumpEdgeConfig,
) -> Candidates:
    """The candidates at one end of the parts; `beyond` is the neighbour past it."""
    index = jnp.arange(segments.xy.shape[0])
    far = segments.range[beyond]
    far = jnp.where(jnp.isinf(far), segments.range_max, far)
    # A surface that goes on straight meets equally spaced beams at equally spaced 1 / range: at
    # grazing incidence the range grows without any discontinuity.
    one = index + inward * jnp.minimum(room, 1)
    course = 2 * segments.range[one] - segments.range
    goes_on = jnp.where(
        course > 0,
        segments.range * segments.range[one] / jnp.where(course > 0, course, 1.0),
        jnp.inf,
    )
    jump = jnp.where(segments.hit, far - jnp.maximum(goes_on, segments.range), 0.0)
    needed = config.jump + config.relative * segments.range
    inner = segments.xy[one]
    step = segments.xy - inner
    # At grazing incidence the last spacing is long and tells little: move 0.1 m at most.
    length = safe_norm(step)
    half = step * (jnp.minimum(0.5 * length, 0.1) / jnp.maximum(length, 1e-6))[:, None]
    return Candidates(
        xy=segments.xy + half,
        kind=jnp.full(index.shape, Kind.JUMP_EDGE.value, jnp.int32),
        salience=config.weight * jnp.minimum(jump, 1.0),
        valid=segments.large & ends & (beyond != index) & (jump > needed),
    )
