"""From the poses that edges vote for to the few that are worth synthetic scans.

Two cheap looks at ever fewer alternatives. The first, a glance, sees them as edges put them, and
prefers places that are like the query's from anywhere near (`aprjax.evaluation.signature`); a brief
refinement of those that pass lets the second look closer.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.alignment.align import AlignmentConfig, Alternatives, counterparts
from aprjax.alignment.voting import Votes
from aprjax.configuration import capacity, threshold
from aprjax.evaluation.raster import GlanceConfig, RasterConfig, glance
from aprjax.evaluation.screen import ScreenConfig, screen
from aprjax.evaluation.signature import likeness
from aprjax.features import Features
from aprjax.numerics import square_gaps
from aprjax.refine import SettleConfig, settle
from aprjax.se2 import Pose


class ShortlistConfig(eqx.Module):
    """The looks, and how many alternatives pass each."""

    glance: GlanceConfig = GlanceConfig()
    alike: Float[Array, ""] = threshold(2.0, "log odds for each unit of the places' likeness")
    settle: SettleConfig = SettleConfig(points=48, iterations=3)
    closer: ScreenConfig = ScreenConfig()
    distance: Float[Array, ""] = threshold(0.1, "metres up to which two poses are one")
    angle: Float[Array, ""] = threshold(0.05, "radians, likewise", most=np.pi)
    passed: int = capacity(96, "alternatives that pass the glance, over all references")
    kept: int = capacity(24, "alternatives that pass the second look")


class Shortlist(eqx.Module):
    """Alternatives of several references, ordered by reference."""

    alternatives: Alternatives
    """`(size,)`."""
    row: Int[Array, " size"]
    """Which reference each belongs to."""

    def best(self, score: Float[Array, " size"], count: int) -> "Shortlist":
        """The `count` of the highest score, ordered by reference.

        Ties of what follows then go to the lowest.
        """
        score = jnp.where(self.alternatives.valid, score, -1.0)
        _, index = jax.lax.top_k(score, min(count, score.shape[0]))
        index = index[jnp.argsort(self.row[index], stable=True)]
        return jax.tree.map(lambda array: array[index], self)


def all_alternatives(aligned: Alternatives, rows: Int[Array, " references"]) -> Shortlist:
    """The alternatives `(references, maxima)` of one query in one row, none left out."""
    return Shortlist(
        alternatives=jax.tree.map(lambda array: array.reshape(-1, *array.shape[2:]), aligned),
        row=jnp.repeat(rows, aligned.valid.shape[1]),
    )


def shortlist(
    votes: Votes,
    references: Features,
    query: Features,
    raster_config: RasterConfig,
    alignment_config: AlignmentConfig,
    config: ShortlistConfig,
) -> Shortlist:
    """The most promising of the poses `(poses,)` that the query's edges voted for.

    `references` are stacked features `(rows, ...)`.
    """
    passed = glance_through(votes, references, query, raster_config, config)
    return look_closer(passed, references, query, alignment_config, config)


def glance_through(
    votes: Votes,
    references: Features,
    query: Features,
    raster_config: RasterConfig,
    config: ShortlistConfig,
) -> Votes:
    """The `passed` poses of the best glance, best first."""
    return pass_on(votes, glances(votes, references, query, raster_config, config), config)


def glances(
    votes: Votes,
    references: Features,
    query: Features,
    raster_config: RasterConfig,
    config: ShortlistConfig,
) -> Float[Array, " poses"]:
    """How well each pose looks at a glance, in [0, 1]: its drawings, and how like the places are.

    The likeness tells which references are near, whatever the pose; `alike` times it counts as a
    logarithm of odds.
    """
    drawn = glance(
        references.raster,
        votes.row,
        query.raster,
        votes.T_ref_query,
        votes.rating,
        raster_config,
        config.glance,
    )
    alike = likeness(references.signature, query.signature)
    return drawn * jnp.exp(config.alike * (alike - 1.0))[votes.row]


def pass_on(votes: Votes, score: Float[Array, " poses"], config: ShortlistConfig) -> Votes:
    """The `passed` valid poses of the highest score, best first."""
    score = jnp.where(votes.valid, score, -1.0)
    _, best = jax.lax.top_k(score, min(config.passed, score.shape[0]))
    return jax.tree.map(lambda array: array[best], votes)


def look_closer(
    passed: Votes,
    references: Features,
    query: Features,
    alignment_config: AlignmentConfig,
    config: ShortlistConfig,
) -> Shortlist:
    """The `kept` alternatives that look best after a brief refinement; see `keep` for which."""
    looks = look(passed, references, query, alignment_config, config)
    return keep(passed, looks, alignment_config, config)


class Looks(NamedTuple):
    """What the second look found, `(passed,)`."""

    T_ref_query: Pose
    """Refined."""
    anchors: Int[Array, " passed"]
    """That agree there."""
    score: Float[Array, " passed"]


def look(
    passed: Votes,
    references: Features,
    query: Features,
    alignment_config: AlignmentConfig,
    config: ShortlistConfig,
) -> Looks:
    """Poses after a brief refinement, and how well they look."""

    def refined(T_ref_query: Pose, row: Int[Array, ""]) -> tuple[Pose, Int[Array, ""]]:
        graph, view = jax.tree.map(lambda array: array[row], (references.graph, references.view))
        T_ref_query = settle(view, query.view, T_ref_query, config.settle)
        distance = alignment_config.agreement
        return T_ref_query, counterparts(graph, query.graph, T_ref_query, distance)

    T_ref_query, anchors = jax.vmap(refined)(passed.T_ref_query, passed.row)
    score = jax.vmap(screen, (None, 0, None, 0, 0, None))(
        references.sketch,
        passed.row,
        query.sketch,
        T_ref_query,
        anchors,
        config.closer,
    )
    return Looks(T_ref_query, anchors, score)


def keep(
    passed: Votes, looks: Looks, alignment_config: AlignmentConfig, config: ShortlistConfig
) -> Shortlist:
    """The `kept` alternatives of the highest score.

    They are valid if as many anchors agree as an alignment needs, and none that looks better is
    the same: cells of both grids, and neighbours, vote for one pose, and settle to one.
    """
    T_ref_query, anchors, score = looks
    enough = anchors.astype(jnp.float32) >= alignment_config.min_anchors
    alternatives = Alternatives(T_ref_query, anchors, passed.count, passed.valid & enough)
    score = jnp.where(alternatives.valid, score, -1.0)
    # Among a few times as many as will be kept: gaps of all pairs would take longer than the look.
    _, best = jax.lax.top_k(score, min(_DISTINCT * config.kept, score.shape[0]))
    listed, score = jax.tree.map(
        lambda array: array[best], (Shortlist(alternatives, passed.row), score)
    )
    again = _repeated(listed.alternatives.T_ref_query, listed.row, score, config)
    listed = eqx.tree_at(
        lambda those: those.alternatives.valid, listed, listed.alternatives.valid & ~again
    )
    return listed.best(score, config.kept)


_DISTINCT = 3
"""Times `kept` alternatives that are compared with each other."""


def _repeated(
    T_ref_query: Float[Array, "size 3"],
    row: Int[Array, " size"],
    score: Float[Array, " size"],
    config: ShortlistConfig,
) -> Bool[Array, " size"]:
    """Whether one of a higher score, or of the same and before it, has about the same pose."""
    cos, sin = jnp.cos(T_ref_query[:, 2]), jnp.sin(T_ref_query[:, 2])
    # The cosine of the angle between two rotations, which needs no wrapping.
    parallel = cos[:, None] * cos[None, :] + sin[:, None] * sin[None, :] >= jnp.cos(config.angle)
    near = square_gaps(T_ref_query, T_ref_query) <= config.distance**2
    place = jnp.arange(score.shape[0])
    before = (score[None, :] == score[:, None]) & (place[None, :] < place[:, None])
    better = (score[None, :] > score[:, None]) | before
    return jnp.any(near & parallel & better & (row[:, None] == row[None, :]), axis=1)
