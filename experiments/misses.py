"""Where the right answer to a query was lost on its way through the stages of matching."""

import dataclasses
from enum import IntEnum
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

import aprjax
from aprjax.alignment.align import agreement, align
from aprjax.alignment.rotation import rotation_peaks
from aprjax.features import Features
from aprjax.metrics import deviations, is_right, relative
from aprjax.numerics import wrap
from aprjax.references import ReferenceIndex
from aprjax.refine import settle
from aprjax.relations.histograms import matching_angles
from aprjax.se2 import Pose
from aprjax.shortlist import Shortlist, all_alternatives, shortlist

NEAR_DISTANCE, NEAR_ANGLE = 2.0, np.radians(40)  # of a reference that shows the query's place
COMMON = 0.15  # metres between anchors that are the same, under the true pose


class Loss(IntEnum):
    """The first stage after which no right alternative was left."""

    NO_COMMON_ANCHORS = 0
    """No reference near by shows two of the query's anchors."""
    WRONG_ROTATION = 1
    """Of those that do, none has a peak of its matching angle histogram at the true rotation."""
    NOT_ALIGNED = 2
    """The right edges were paired with others, or clustered to a wrong pose."""
    FIRST_LOOK = 3
    """The right alternatives did not pass the shortlist's first look."""
    SECOND_LOOK = 4
    """Nor, after its brief refinement, the second."""
    DIVERGED = 5
    """Refinement moved all right alternatives away."""
    RANKED_BELOW = 6
    """A right alternative was evaluated, and a wrong one had a higher e_m."""


class Stages(eqx.Module):
    """What was left of one query after each stage, and what led there."""

    common: Int[Array, "*batch references"]
    """Anchors of the query that the reference shows, under the true pose."""
    rotated: Bool[Array, "*batch references"]
    """A peak of the matching angle histogram is at the true rotation."""
    aligned: Shortlist
    """The alternatives of all references."""
    passed: Shortlist
    """Those that pass the shortlist's first look."""
    kept: Shortlist
    """Those that pass the second, as its brief refinement left them."""
    settled: Shortlist
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
    references are aligned, whatever the configuration's `top_k`.
    """
    described = aprjax.ReferenceSet.build(queries, references.index.config).index.features
    slots = described.view.beams.shape[0]
    T_ref_query = relative(T_world_ref[None], T_world_query[:, None])
    rows = references.index.ids.shape[0]
    missing = [(0, slots - len(queries.ranges)), (0, rows - len(references)), (0, 0)]
    padded = np.pad(T_ref_query, missing).astype(np.float32)
    config = aprjax.MatchConfig() if config is None else config
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
        (stages.aligned, Loss.FIRST_LOOK),
    ):
        # Rows past the references are padding, where nothing is valid.
        true = T_ref_query[np.minimum(left.row, len(T_ref_query) - 1)]
        poses = np.asarray(left.alternatives.T_ref_query)
        if np.any(left.alternatives.valid & is_right(poses, true)):
            return loss
    gap, turn = deviations(T_ref_query, np.zeros(3))
    shows = (gap <= NEAR_DISTANCE) & (turn <= NEAR_ANGLE) & (stages.common[: len(gap)] >= 2)
    if not shows.any():
        return Loss.NO_COMMON_ANCHORS
    return Loss.NOT_ALIGNED if np.any(shows & stages.rotated[: len(gap)]) else Loss.WRONG_ROTATION


@jax.jit
def _all_stages(
    queries: Features,
    references: ReferenceIndex,
    T_ref_query: Float[Array, "queries references 3"],
    config: aprjax.MatchConfig,
) -> Stages:
    """One query after the other: what one needs stays in the cache."""
    relation = references.config.relation
    angles = matching_angles(queries.histogram, references.features.histogram, relation)
    one = partial(_stages, references=references, config=config)
    return jax.lax.map(lambda of: one(*of), (queries, angles, T_ref_query))


def _stages(
    query: Features,
    angles: Float[Array, "references direction_bins"],
    T_ref_query: Float[Array, "references 3"],
    references: ReferenceIndex,
    config: aprjax.MatchConfig,
) -> Stages:
    """The matcher's stages up to the refinement of what the shortlist keeps."""
    graphs, views = references.features.graph, references.features.view

    def truth(graph, angles, T_ref_query):
        same = agreement(graph, query.graph, T_ref_query, jnp.float32(COMMON))
        peaks = rotation_peaks(angles, config.alignment.rotation)
        off = jnp.abs(wrap(peaks.angle - T_ref_query[2]))
        at = (peaks.votes > 0) & (off <= config.alignment.correspondence.angle)
        return jnp.sum(jnp.any(same, axis=0), dtype=jnp.int32), jnp.any(at)

    common, rotated = jax.vmap(truth)(graphs, angles, T_ref_query)
    aligned = jax.vmap(align, (0, None, 0, None))(graphs, query.graph, angles, config.alignment)
    aligned = eqx.tree_at(lambda a: a.valid, aligned, aligned.valid & references.valid[:, None])
    rows = jnp.arange(references.ids.shape[0])
    everything = passed = kept = all_alternatives(aligned, rows)
    if config.cascade:
        rules = config.shortlist
        # Where as many are kept as pass, there is no second look.
        one_look = dataclasses.replace(rules, kept=max(rules.kept, rules.passed))
        passed = shortlist(aligned, rows, views, query.view, one_look)
        kept = shortlist(aligned, rows, views, query.view, rules)

    def refined(T_ref_query: Pose, row: Int[Array, ""]) -> Pose:
        reference = jax.tree.map(lambda array: array[row], views)
        return settle(reference, query.view, T_ref_query, config.refine)

    poses = jax.vmap(refined)(kept.alternatives.T_ref_query, kept.row)
    settled = eqx.tree_at(lambda each: each.alternatives.T_ref_query, kept, poses)
    return Stages(common, rotated, everything, passed, kept, settled)
