"""Alignment of two anchor graphs: several alternatives for each likely rotation (paper 2.C)."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.alignment.cluster import ClusterConfig, centre_of_gravity, contributions
from aprjax.alignment.correspondence import CorrespondenceConfig, correspondence_matrices
from aprjax.alignment.rotation import RotationConfig, rotation_peaks
from aprjax.configuration import capacity, threshold
from aprjax.numerics import square_gaps, wrap
from aprjax.relations.graph import AnchorGraph
from aprjax.se2 import Pose, transform


class AlignmentConfig(eqx.Module):
    """From the matching angle histogram to transformations."""

    rotation: RotationConfig = RotationConfig()
    correspondence: CorrespondenceConfig = CorrespondenceConfig()
    cluster: ClusterConfig = ClusterConfig()
    agreement: Float[Array, ""] = threshold(0.25, "metres between anchors that agree")
    min_anchors: Float[Array, ""] = threshold(2, "anchors that must agree")
    maxima: int = capacity(12, "alternatives: maxima of the matrices of all rotations together")


class Alternatives(eqx.Module):
    """Alignments of a query with a reference, that of the highest maximum first."""

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
    """The alternatives `(maxima,)` of one query and one reference.

    All anchors that agree on one alignment have high entries in the correspondence matrix; once
    it is found, its pairs are taken out, so that the next maximum stands for another one.
    """
    rotations = rotation_peaks(histogram, config.rotation)
    matrices = correspondence_matrices(reference, query, rotations.angle, config.correspondence)
    matrices = jnp.where((rotations.votes > 0)[:, None, None], matrices, 0)
    weight = jnp.any(query.valid, axis=1).astype(jnp.float32)
    weight = weight / jnp.maximum(jnp.sum(weight), 1.0)
    centre = jnp.sum(weight[:, None] * query.xy, axis=0)

    def next_maximum(matrices: Int[Array, "rotations n m"], _):
        votes, (r, i, j) = _maximum(matrices)
        rotation = rotations.angle[r]
        found = contributions(reference, query, i, j, rotation, centre, config.correspondence)
        T_ref_query, size = centre_of_gravity(found, rotation, centre, config.cluster)
        agree = agreement(reference, query, T_ref_query, config.agreement)
        anchors = jnp.sum(jnp.any(agree, axis=0), dtype=jnp.int32)
        enough = anchors.astype(jnp.float32) >= config.min_anchors
        alternative = Alternatives(
            T_ref_query=T_ref_query,
            anchors=anchors,
            votes=votes,
            valid=(votes > 0) & (size > 0) & enough,
        )
        turned = wrap(rotations.angle - T_ref_query[2])
        alike = jnp.abs(turned) <= 2 * config.correspondence.angle
        explained = alike[:, None, None] & agree[None, :, :]
        return jnp.where(explained, 0, matrices).at[r, i, j].set(0), alternative

    _, found = jax.lax.scan(next_maximum, matrices, length=config.maxima)
    return found


def agreement(
    reference: AnchorGraph, query: AnchorGraph, T_ref_query: Pose, distance: Float[Array, ""]
) -> Bool[Array, "n m"]:
    """Which anchors of the reference and of the query come to lie within `distance` metres."""
    moved = transform(T_ref_query, query.xy)
    near = square_gaps(reference.xy, moved) <= distance**2
    return near & jnp.any(reference.valid, axis=1)[:, None] & jnp.any(query.valid, axis=1)[None, :]


def counterparts(
    reference: AnchorGraph, query: AnchorGraph, T_ref_query: Pose, distance: Float[Array, ""]
) -> Int[Array, ""]:
    """How many anchors of the query have one of the reference within `distance` metres."""
    agree = agreement(reference, query, T_ref_query, distance)
    return jnp.sum(jnp.any(agree, axis=0), dtype=jnp.int32)


def _maximum(array: Int[Array, "r n m"]) -> tuple[Int[Array, ""], tuple[Array, Array, Array]]:
    """The largest entry, a small count, and its indices; the first of equals.

    Value and position in one integer make this a plain maximum, which XLA vectorises.
    """
    size = array.size
    rank = size - 1 - jnp.arange(size, dtype=jnp.int32).reshape(array.shape)
    best = jnp.max(array * size + rank)
    position = size - 1 - best % size
    _, n, m = array.shape
    return best // size, (position // (n * m), position // m % n, position % m)
