"""A quick check of many alignments: does either scan's end points lie where the other saw them?

Every alternative of every reference passes here, so that only those which earned it get a
synthetic scan. No surfaces are joined and nothing is refined: a thinned set of end points is
looked up by bearing in the other view.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.congruence import QualityConfig, Verdicts, quality
from aprjax.evaluation.view import View
from aprjax.numerics import safe_norm
from aprjax.se2 import Pose, inverse, transform


class ScreenConfig(eqx.Module):
    """Which end points are looked up, and when they agree."""

    tolerance: Float[Array, ""] = threshold(0.15, "metres off the other scan's range")
    relative: Float[Array, ""] = threshold(0.02, "the same, per metre of range")
    quality: QualityConfig = QualityConfig()
    points: int = capacity(48, "most end points of each scan")


def screen(
    reference: View,
    query: View,
    T_ref_query: Pose,
    anchors: Int[Array, ""],
    config: ScreenConfig,
) -> Float[Array, ""]:
    """A rough e_m in [0, 1] of one unrefined alignment; both ways count."""
    ahead = _one_way(reference, query, T_ref_query, config)
    back = _one_way(query, reference, inverse(T_ref_query), config)
    both = jnp.asarray(True)
    return quality(ahead, back, both, both, anchors, config.quality)


def _one_way(other: View, ours: View, T_other_ours: Pose, config: ScreenConfig) -> Verdicts:
    """How our end points lie in the other view. What lies behind its surfaces says nothing."""
    beam, real = ours.thin(config.points)
    hit = ours.hit[beam] & real
    xy = transform(T_other_ours, ours.xy[beam])
    distance = safe_norm(xy)
    index, visible = other.look_up(xy)
    beyond = distance - other.range[index]
    tolerance = config.tolerance + config.relative * distance
    met = hit & visible & other.hit[index]
    return Verdicts.count(
        met & (jnp.abs(beyond) <= tolerance), met & (beyond < -tolerance), hit, xy
    )
