"""Alignment of two anchor graphs: several alternatives for each likely rotation (paper 2.C)."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.alignment.cluster import ClusterConfig, centre_of_gravity, contributions
from aprjax.alignment.correspondence import CorrespondenceConfig, correspondence_matrix
from aprjax.alignment.rotation import RotationConfig, rotation_peaks
from aprjax.configuration import capacity, threshold
from aprjax.relations.graph import AnchorGraph
from aprjax.se2 import Pose, transform


class AlignmentConfig(eqx.Module):
    """From the matching angle histogram to transformations."""

    rotation: RotationConfig = RotationConfig()
    correspondence: CorrespondenceConfig = CorrespondenceConfig()
    cluster: ClusterConfig = ClusterConfig()
    agreement: Float[Array, ""] = threshold(0.25, "metres between anchors that agree")
    min_anchors: Float[Array, ""] = threshold(2, "anchors that must agree")
    maxima: int = capacity(2, "maxima of the correspondence matrix for each rotation")


class Alternatives(eqx.Module):
    """Alignments of a query with a reference, in no particular order."""

    T_ref_query: Pose
    """Metres and radians."""
    anchors: Int[Array, "*batch"]
    """Anchors of the query that agree with one of the reference."""
    votes: Int[Array, "*batch"]
    """Entry of the correspondence matrix at the maximum behind it."""
    valid: Bool[Array, "*batch"]


def align(
    reference: AnchorGraph,
    query: AnchorGraph,
    histogram: Float[Array, " direction_bins"],
    config: AlignmentConfig,
) -> Alternatives:
    """The `2 * peaks * maxima` alternatives of one query and one reference."""
    rotations = rotation_peaks(histogram, config.rotation)
    found = jax.vmap(lambda angle: _align_rotated(reference, query, angle, config))(rotations.angle)
    found = eqx.tree_at(lambda f: f.valid, found, found.valid & (rotations.votes > 0)[:, None])
    return jax.tree.map(lambda array: array.reshape(-1, *array.shape[2:]), found)


def _align_rotated(
    reference: AnchorGraph, query: AnchorGraph, rotation: Float[Array, ""], config: AlignmentConfig
) -> Alternatives:
    """The alternatives for one rotation, from the maxima of its correspondence matrix.

    All anchors that agree on one alignment have high entries; once it is found, its pairs are
    taken out, so that the next maximum stands for another one.
    """
    matrix = correspondence_matrix(reference, query, rotation, config.correspondence)
    real_query, real_reference = jnp.any(query.valid, axis=1), jnp.any(reference.valid, axis=1)
    weight = real_query / jnp.maximum(jnp.sum(real_query), 1)
    centre = jnp.sum(weight[:, None] * query.xy, axis=0)

    def next_maximum(matrix, _):
        best = jnp.argmax(matrix)
        pair = jnp.unravel_index(best, matrix.shape)
        found = contributions(reference, query, pair, rotation, centre, config.correspondence)
        T_ref_query, size = centre_of_gravity(found, centre, config.cluster)
        gap = reference.xy[:, None] - transform(T_ref_query, query.xy)
        agree = (jnp.sum(gap * gap, axis=-1) <= config.agreement**2) & real_reference[:, None]
        agree = agree & real_query
        anchors = jnp.sum(jnp.any(agree, axis=0), dtype=jnp.int32)
        votes = matrix[pair]
        left = jnp.where(agree, 0, matrix).at[pair].set(0)
        valid = (votes > 0) & (size > 0) & (anchors >= config.min_anchors)
        return left, Alternatives(
            T_ref_query=T_ref_query, anchors=anchors, votes=votes, valid=valid
        )

    _, found = jax.lax.scan(next_maximum, matrix, length=config.maxima)
    return found
