"""Congruence of two aligned scans, and the quality e_m (paper 2.D)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from aprjax.evaluation.synthetic_scan import synthetic_scan
from aprjax.evaluation.view import View
from aprjax.numerics import safe_norm, threshold
from aprjax.se2 import Pose, inverse, transform


class CongruenceConfig(eqx.Module):
    """When a beam agrees with the synthetic scan, and what that is worth."""

    tolerance: Float[Array, ""] = threshold(0.15, "metres between real and synthetic range")
    relative: Float[Array, ""] = threshold(0.02, "the same, per metre of range")


class Beams(eqx.Module):
    """Verdicts of the front scan's beams, as numbers of beams."""

    agree: Float[Array, ""]
    through: Float[Array, ""]
    """Contradiction: the front scan sees through what the synthetic one claims."""
    short: Float[Array, ""]
    """Contradiction: it stops where the overview scan saw free space."""
    hits: Float[Array, ""]
    """All hits of the front scan; the rest says nothing."""


def compare(overview: View, front: View, T_front_overview: Pose, config: CongruenceConfig) -> Beams:
    """Beam by beam comparison of a real front scan with the synthetic one."""
    inverse_range = synthetic_scan(overview, T_front_overview, front.bearings)
    known = inverse_range > 0
    expected = 1.0 / jnp.where(known, inverse_range, 1.0)
    measured = jnp.where(front.hit, front.range, 0.0)
    tolerance = config.tolerance + config.relative * measured
    agree = front.hit & known & (jnp.abs(measured - expected) <= tolerance)
    through = front.hit & known & (measured > expected + tolerance)

    seen = transform(inverse(T_front_overview), front.xy)
    index, visible = overview.look_up(seen)
    free = overview.range[index] > safe_norm(seen) + tolerance
    short = front.hit & ~agree & ~through & visible & free & overview.hit[index]

    def count(which):
        return jnp.sum(which, dtype=jnp.float32)

    return Beams(agree=count(agree), through=count(through), short=count(short), hits=count(front.hit))
