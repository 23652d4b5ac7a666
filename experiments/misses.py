"""Where the right answer to a query was lost on its way through the stages of matching."""

from enum import IntEnum
from functools import partial
from typing import Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

import aprjax
from aprjax.alignment.align import counterparts
from aprjax.alignment.voting import Votes, vote
from aprjax.features import Features
from aprjax.metrics import is_near, is_right
from aprjax.plane import relative
from aprjax.references import ReferenceIndex
from aprjax.refine import settle
from aprjax.se2 import Pose
from aprjax.shortlist import Shortlist, glance_through, look_closer

COMMON = 0.15  # metres between anchors that are the same, under the true pose


class Loss(IntEnum):
    """The first stage after which no right alternative was left."""

    NO_COMMON_ANCHORS = 0
    """No reference near by shows two of the query's anchors."""
    NOT_VOTED = 1
    """Of the poses that edges voted for, none that was kept is right."""
    FIRST_LOOK = 2
    """The right poses did not pass the glance."""
    SECOND_LOOK = 3
    """Nor, after their brief refinement, the second look."""
    DIVERGED = 4
    """Refinement moved all right alternatives away."""
    RANKED_BELOW = 5
    """A right alternative was evaluated, and a wrong one had a higher e_m."""


class Poses(eqx.Module):
    """What was left of one query after a stage, in all references."""

    T_ref_query: Float[Array, "*batch size 3"]
    """Metres and radians."""
    row: Int[Array, "*batch size"]
    """The reference."""
    valid: Bool[Array, "*batch size"]

    @classmethod
    def voted(cls, votes: Votes) -> Self:
        """Those that edges voted for."""
        return cls(votes.T_ref_query, votes.row, votes.valid)

    @classmethod
    def listed(cls, listed: Shortlist) -> Self:
        """Those of a shortlist."""
        return cls(listed.alternatives.T_ref_query, listed.row, listed.alternatives.valid)


class Stages(eqx.Module):
    """What was left of one query after each stage, and what led there."""

    common: Int[Array, "*batch references"]
    """Anchors of the query that the reference shows, under the true pose."""
    voted: Poses
    """The poses that edges voted for."""
    passed: Poses
    """Those that pass the glance."""
    kept: Poses
    """Those that pass the second look, as its brief refinement left them."""
    settled: Poses
    """The same, refined."""


def losses(
    queries: aprjax.Scan,
    references: aprjax.ReferenceSet,
    T_world_ref: np.ndarray,
    T_world_query: np.ndarray,
    config: aprjax.MatchConfig | None = None,
) -> np.ndarray:
    """The `Loss` of each of the stacked queries `(queries,)` that were not answered rightly.

    The true poses `(references, 3)` and `(queries, 3)` are in the order of the scans. All
    references are compared, whatever the configuration's `top_k`. Raises `ValueError` for a
    configuration without the cascade, whose stages these are.
    """
    config = aprjax.MatchConfig() if config is None else config
    if not config.cascade:
        raise ValueError("config: without the cascade there are no votes and no looks")
    described = aprjax.ReferenceSet.build(queries, references.config).index.features
    slots = described.view.beams.shape[0]
    T_ref_query = relative(T_world_ref[None], T_world_query[:, None])
    rows = references.index.ids.shape[0]
    missing = [(0, slots - len(queries.ranges)), (0, rows - len(references)), (0, 0)]
    padded = np.pad(T_ref_query, missing).astype(np.float32)
    found = jax.device_get(_all_stages(described, references.index, padded, config))
    return np.array(
        [
            lost(jax.tree.map(lambda array: array[k], found), true)  # noqa: B023
            for k, true in enumerate(T_ref_query)
        ],
        int,
    )


def lost(stages: Stages, T_ref_query: np.ndarray) -> Loss:
    """Where one query was lost whose true poses in the references are `(references, 3)`.

    Looked for from the end: a later stage may bring a wrong alternative to the right pose.
    """
    for left, loss in (
        (stages.settled, Loss.RANKED_BELOW),
        (stages.kept, Loss.DIVERGED),
        (stages.passed, Loss.SECOND_LOOK),
        (stages.voted, Loss.FIRST_LOOK),
    ):
        # Rows past the references are padding, where nothing is valid.
        true = T_ref_query[np.minimum(left.row, len(T_ref_query) - 1)]
        if np.any(left.valid & is_right(np.asarray(left.T_ref_query), true)):
            return loss
    near = is_near(T_ref_query, np.zeros(3))
    shows = near & (stages.common[: len(near)] >= 2)
    return Loss.NOT_VOTED if shows.any() else Loss.NO_COMMON_ANCHORS


@jax.jit
def _all_stages(
    queries: Features,
    references: ReferenceIndex,
    T_ref_query: Float[Array, "queries references 3"],
    config: aprjax.MatchConfig,
) -> Stages:
    """One query after the other: what one needs stays in the cache."""
    one = partial(_stages, references=references, config=config)
    return jax.lax.map(lambda of: one(*of), (queries, T_ref_query))


def _stages(
    query: Features,
    T_ref_query: Float[Array, "references 3"],
    references: ReferenceIndex,
    config: aprjax.MatchConfig,
) -> Stages:
    """The matcher's stages up to the refinement of what the shortlist keeps."""
    features = references.features
    common = jax.vmap(counterparts, (0, None, 0, None))(
        features.graph, query.graph, T_ref_query, jnp.float32(COMMON)
    )
    voted = vote(
        references.edges,
        features.histogram.edges,
        references.valid,
        query.graph,
        config.voting,
    )
    passed = glance_through(voted, features, query, references.config.raster, config.listing)
    kept = Poses.listed(look_closer(passed, features, query, config.alignment, config.listing))

    def refined(T_ref_query: Pose, row: Int[Array, ""]) -> Pose:
        reference = jax.tree.map(lambda array: array[row], features.view)
        return settle(reference, query.view, T_ref_query, config.refine)

    settled = Poses(jax.vmap(refined)(kept.T_ref_query, kept.row), kept.row, kept.valid)
    return Stages(common, Poses.voted(voted), Poses.voted(passed), kept, settled)
