"""Rivals: alternatives of one query that cannot hold together.

Not in the paper, which reports single false matches where places look alike. Two alternatives of
a query say how the references behind them lie to each other. If both are right, the references
then see the same surroundings; if their scans contradict each other there, one of the two is
wrong, and neither is as certain as its own e_m says. No pose of a reference is needed; where both
references have one, geometry decides instead, and tells apart even places that look the same.

Nothing is kept between queries: `rivals` alternatives are compared with the best one, two synthetic
scans each, however many references there are. Where more hypotheses are asked for, the others are
compared too, for what they lose themselves; they take nothing from the best.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.congruence import CongruenceConfig, both_ways
from aprjax.evaluation.view import View
from aprjax.numerics import wrap
from aprjax.se2 import Pose, compose, inverse


class DistinctivenessConfig(eqx.Module):
    """When two alternatives are rivals, and what a rival costs."""

    weight: Float[Array, ""] = threshold(
        0.5, "share of the strongest rival's e_m that is taken", most=1.0
    )
    contradiction: Float[Array, ""] = threshold(
        0.25,
        "share of contradicting beams from which two references show different places",
        most=1.0,
    )
    harmony: Float[Array, ""] = threshold(
        0.15, "share up to which they show the same place", most=1.0
    )
    distance: Float[Array, ""] = threshold(0.4, "metres between distinct poses in one frame")
    angle: Float[Array, ""] = threshold(0.2, "radians, likewise", most=np.pi)
    equal: Float[Array, ""] = threshold(
        0.9, "share of the best e_m at which a rival is its equal; above one none is"
    )
    rivals: int = capacity(16, "alternatives, best first, that may be rivals of the best")
    beams: int = capacity(64, "most beams of either scan that are compared")


class Placement(eqx.Module):
    """Where references were taken, as far as that is known."""

    T_world_ref: Float[Array, "rows 3"]
    """Poses in one frame, its origin in their middle; zero where not known."""
    known: Bool[Array, " rows"]


def rivalry(
    best: Int[Array, ""],
    other: Int[Array, ""],
    T_best_query: Pose,
    T_other_query: Pose,
    references: View,
    placement: Placement,
    congruence_config: CongruenceConfig,
    config: DistinctivenessConfig,
) -> Float[Array, ""]:
    """How far two alternatives exclude each other: 0 for the same place, 1 for different ones.

    `best` and `other` are rows of `references` and of `placement`. Two poses in one reference, or
    in two whose places are known, are either one pose or exclude each other. For two other
    references it is the share of contradicting beams that counts, between `harmony` and
    `contradiction`; scans that do not overlap exclude nothing.
    """
    view_best, view_other = (
        jax.tree.map(lambda array: array[row], references)  # noqa: B023
        for row in (best, other)
    )
    rules = replace(congruence_config, beams=config.beams)
    T_best_other = compose(T_best_query, inverse(T_other_query))
    ahead, back = both_ways(view_best, view_other, T_best_other, rules)
    contradict = ahead.contradict + back.contradict
    share = contradict / jnp.maximum(ahead.agree + back.agree + contradict, 1.0)
    span = jnp.maximum(config.contradiction - config.harmony, 1e-6)
    different_places = jnp.clip((share - config.harmony) / span, 0.0, 1.0)

    T_world_best, T_world_other = placement.T_world_ref[best], placement.T_world_ref[other]
    one_frame = (best == other) | (placement.known[best] & placement.known[other])
    same = same_pose(
        compose(T_world_best, T_best_query), compose(T_world_other, T_other_query), config
    )
    return jnp.where(one_frame, jnp.where(same, 0.0, 1.0), different_places)


def distinct_quality(
    e_m: Float[Array, " size"],
    rivalry_with_best: Float[Array, " size"],
    config: DistinctivenessConfig,
) -> tuple[Float[Array, " size"], Float[Array, ""]]:
    """Qualities in [0, 1] less what their rivals cost, and the strength of the best one's rival.

    The best alternative and those at its place lose to the strongest that excludes them; those
    that exclude the best lose to it, a share of their own e_m at most. The best stays the best.
    Alternatives come best first, and only the first `rivals` may be the strongest: asking for more
    changes no quality.
    """
    best = jnp.max(e_m)
    strongest = jnp.max((rivalry_with_best * e_m)[: config.rivals])
    against = rivalry_with_best * best + (1.0 - rivalry_with_best) * strongest
    return e_m - config.weight * jnp.minimum(against, e_m), strongest


def same_pose(T_a: Pose, T_b: Pose, config: DistinctivenessConfig) -> Bool[Array, "*batch"]:
    """Whether two poses in one frame are one hypothesis; leading axes broadcast."""
    gap = jnp.sum((T_a[..., :2] - T_b[..., :2]) ** 2, axis=-1)
    turn = jnp.abs(wrap(T_a[..., 2] - T_b[..., 2]))
    return (gap < config.distance**2) & (turn < config.angle)
