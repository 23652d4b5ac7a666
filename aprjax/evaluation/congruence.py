"""Congruence of two aligned scans, and the quality e_m (paper 2.D)."""

from typing import Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.synthetic_scan import synthetic_scan
from aprjax.evaluation.view import View, facing
from aprjax.numerics import safe_norm, sums
from aprjax.se2 import Pose, inverse, transform

_TINY = np.finfo(np.float32).tiny


class QualityConfig(eqx.Module):
    """How much agreement makes a good match."""

    doubt: Float[Array, ""] = threshold(0.1, "doubtful beams assumed beforehand, a share of hits")
    contradiction: Float[Array, ""] = threshold(1.5, "agreeing beams that one contradiction undoes")
    anchors: Float[Array, ""] = threshold(3.0, "agreeing anchors that are worth one half")
    extent: Float[Array, ""] = threshold(2.0, "metres of agreeing surface that are worth one half")


class CongruenceConfig(eqx.Module):
    """When a beam agrees with the synthetic scan, and what agreement is worth."""

    tolerance: Float[Array, ""] = threshold(0.08, "metres between real and synthetic range")
    relative: Float[Array, ""] = threshold(0.015, "the same, per metre of range")
    beams: int = capacity(128, "most beams of the front scan that are compared")
    quality: QualityConfig = QualityConfig()


class Verdicts(eqx.Module):
    """What the beams of a front scan say about an alignment, as numbers of beams."""

    agree: Float[Array, "*batch"]
    """The synthetic scan has the surface where the beam met it."""
    contradict: Float[Array, "*batch"]
    """The beam passed through a surface of the synthetic scan, or stopped in free space."""
    hits: Float[Array, "*batch"]
    """All beams that met a surface; those neither of the above say nothing."""
    extent: Float[Array, "*batch"]
    """Root mean square distance of the agreeing end points from their centre, in metres."""

    @classmethod
    def count(
        cls,
        agree: Bool[Array, " beams"],
        contradict: Bool[Array, " beams"],
        hit: Bool[Array, " beams"],
        x: Float[Array, " beams"],
        y: Float[Array, " beams"],
    ) -> Self:
        """The verdicts of single beams with end points `(x, y)`, together."""
        one = agree.astype(jnp.float32)
        number, against, hits, sum_x, sum_y, square = sums(
            one,
            contradict.astype(jnp.float32),
            hit.astype(jnp.float32),
            one * x,
            one * y,
            one * (x * x + y * y),
        )
        share = 1.0 / jnp.maximum(number, 1.0)
        spread = share * square - (share * sum_x) ** 2 - (share * sum_y) ** 2
        return cls(
            agree=number,
            contradict=against,
            hits=hits,
            extent=jnp.sqrt(jnp.maximum(spread, 0.0)),
        )


def congruence(
    overview: View, front: View, T_front_overview: Pose, config: CongruenceConfig
) -> Verdicts:
    """The real front scan against the synthetic one, beam by beam.

    A beam that stops short of the synthetic surface contradicts only if the overview scan saw
    free space there; otherwise something was hidden from the overview. Beams without return say
    nothing: glass and dark or grazed surfaces return as little as free space.
    """
    beam, real = front.thin(config.beams)
    hit, xy = front.hit[beam] & real, front.xy[beam]
    inverse_range = synthetic_scan(overview, T_front_overview, front.bearings[beam])
    known = hit & (inverse_range > 0)
    measured = jnp.where(hit, front.range[beam], 0.0)
    beyond = measured - 1.0 / jnp.where(known, inverse_range, 1.0)
    tolerance = config.tolerance + config.relative * measured
    agree = known & (jnp.abs(beyond) <= tolerance)
    through = known & (beyond > tolerance)

    seen = transform(inverse(T_front_overview), xy)
    index, visible = overview.look_up(seen)
    free = overview.hit[index] & (overview.range[index] > safe_norm(seen) + tolerance)
    short = hit & ~agree & ~through & visible & free
    return Verdicts.count(agree, through | short, hit, xy[:, 0], xy[:, 1])


def both_ways(
    reference: View, query: View, T_ref_query: Pose, config: CongruenceConfig
) -> tuple[Verdicts, Verdicts]:
    """What the query's beams say of the reference's synthetic scan, and the other way about."""
    overviews, fronts = facing(reference, query)
    T_front_overview = jnp.stack([inverse(T_ref_query), T_ref_query])
    verdicts = jax.vmap(congruence, (0, 0, 0, None))(overviews, fronts, T_front_overview, config)
    ahead, back = (jax.tree.map(lambda array: array[k], verdicts) for k in range(2))  # noqa: B023
    return ahead, back


def sees(overview: View, front_xy: Float[Array, "2"]) -> Bool[Array, ""]:
    """Whether the overview scan contains the front scan's sensing position (paper 2.D)."""
    index, visible = overview.look_up(front_xy[None])
    distance = safe_norm(front_xy[None])
    return ((visible & (overview.range[index] > distance)) | (distance < 1e-3))[0]


def quality(
    ahead: Verdicts,
    back: Verdicts,
    reference_sees: Bool[Array, ""],
    query_sees: Bool[Array, ""],
    anchors: Int[Array, ""],
    config: QualityConfig,
) -> Float[Array, ""]:
    """e_m in [0, 1]: how far two scans agree, and on how much.

    `ahead` holds the verdicts of the query's beams on the synthetic scan from the reference,
    `back` those of the reference's beams on the one from the query. The paper compares one way,
    from the scan with the better overview: that which contains the other's sensing position.
    Where both scans contain each other's position, or neither does, both ways count.

    The paper does not state its measure. Ours is κ κ' a / (a + a₀) s / (s + s₀): κ is the share of
    agreeing beams among those that say anything, with some doubt assumed beforehand so that a
    small overlap is never enough. The factor of the a agreeing anchors keeps walls that happen
    to coincide from passing for a place, and that of the extent s of what agrees keeps a corner
    or a niche seen from close by from doing so: there are many alike.
    """

    def consistent(verdicts: Verdicts) -> Float[Array, ""]:
        against = config.contradiction * verdicts.contradict + config.doubt * verdicts.hits
        share = verdicts.agree / jnp.maximum(verdicts.agree + against, 1.0)
        return jnp.minimum((1.0 + config.doubt) * share, 1.0)

    ahead_, back_ = consistent(ahead), consistent(back)
    first = jnp.where(query_sees & ~reference_sees, back_, ahead_)
    second = jnp.where(reference_sees & ~query_sees, ahead_, back_)
    count = anchors.astype(jnp.float32)
    extent = 0.5 * (ahead.extent + back.extent)
    return (first * second) * worth(count, config.anchors) * worth(extent, config.extent)


def worth(amount: Float[Array, "*batch"], half: Float[Array, ""]) -> Float[Array, "*batch"]:
    """What an amount is worth, in [0, 1]: nothing is worth zero, `half` one half.

    Where `half` is zero any other amount is worth one.
    """
    return amount / jnp.maximum(amount + half, _TINY)
