"""Jump edge anchors: convex edges of which one face is visible (paper 2.A).

The near end of a range discontinuity. Where a part ends because a nearer object hides the rest
of it, because the field of view ends, or because the next beam says nothing, there is no edge.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

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


def _ends(segments, beyond, ends, room, inward, config) -> Candidates:
    index = jnp.arange(segments.xy.shape[0])
    far = segments.range[beyond]
    jump = jnp.where(jnp.isinf(far), 10.0, far - segments.range)
    needed = config.jump + config.relative * segments.range
    inner = segments.xy[index + inward * jnp.minimum(room, 1)]
    step = segments.xy - inner
    # At grazing incidence the last spacing is long and tells little: move 0.1 m at most.
    length = safe_norm(step)
    half = step * (jnp.minimum(0.5 * length, 0.1) / jnp.maximum(length, 1e-6))[:, None]
    return Candidates(
        xy=segments.xy + half,
        kind=jnp.full(index.shape, Kind.JUMP_EDGE),
        salience=config.weight * jnp.minimum(jump, 1.0),
        valid=segments.large & ends & (beyond != index) & (jump > needed),
    )
