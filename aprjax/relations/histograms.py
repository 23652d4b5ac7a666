"""Histograms of edge lengths and directions: the relation database for batches (paper 2.B).

With lengths quantised to bins and a tolerance of whole bins, the number of corresponding edges
of two graphs is a product of their length histograms, so that one matrix product counts for all
queries and references at once; it equals the search of the index table on quantised lengths.
With directions as a second axis, the circular correlation over them is the paper's matching
angle histogram (2.C) against every reference, by Fourier transform.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.numerics import HIGHEST
from aprjax.relations.graph import AnchorGraph


class RelationConfig(eqx.Module):
    """How edges are quantised, and how far apart corresponding ones may be."""

    bin_length: Float[Array, ""] = threshold(0.1, "metres for each length bin", least=0.001)
    length_bins: int = capacity(160, "bins of length; longer edges do not take part")
    direction_bins: int = capacity(60, "bins over half a turn; an edge has no sense")
    length_tolerance: int = capacity(1, "bins that corresponding lengths may differ by", least=0)
    parts: int = capacity(4, "parts of a length bin, by which edges are counted for q_m")
    part_tolerance: int = capacity(
        1, "parts that corresponding lengths may differ by, for q_m", least=0
    )


class EdgeHistogram(eqx.Module):
    """The edges of one graph, counted by length and direction."""

    lengths: Float[Array, "*batch length_parts"]
    """Edges in each part of a bin of length; whole numbers."""
    edges: Float[Array, "*batch"]
    """k, the number of all edges, also of those too long to be counted."""


def length_bin(
    graph: AnchorGraph, width: Float[Array, ""], bins: int
) -> Int[Array, "anchors anchors"]:
    """The bin of each edge's length, `width` metres each; `bins` for those that are longer."""
    number = jnp.floor(graph.length / width).astype(jnp.int32)
    return jnp.where(graph.valid & (number < bins), number, bins)


def edge_histogram(graph: AnchorGraph, config: RelationConfig) -> EdgeHistogram:
    """The histogram of one anchor graph by parts of a length bin.

    q_m counts by parts, for accidental correspondences are as many as the tolerance is wide.
    """
    upper = np.triu_indices(graph.length.shape[-1], k=1)
    size = config.parts * config.length_bins
    fine = length_bin(graph, config.bin_length / config.parts, size)[upper]
    return EdgeHistogram(
        lengths=jnp.zeros(size).at[fine].add(1.0, mode="drop"),
        edges=graph.edges.astype(jnp.float32),
    )


def direction_spectrum(
    graph: AnchorGraph, config: RelationConfig
) -> Complex[Array, "frequencies length_bins"]:
    """Fourier transform over direction of one graph's edges in each bin of length and direction.

    Rotations take whole bins of length: right edges must not be missed there, and accidental ones
    do not agree on an angle.
    """
    upper = np.triu_indices(graph.length.shape[-1], k=1)
    lengths = length_bin(graph, config.bin_length, config.length_bins)[upper]
    unit = graph.unit[upper]
    direction = jnp.arctan2(unit[:, 1], jnp.where(lengths < config.length_bins, unit[:, 0], 1.0))
    turns = direction / np.pi * config.direction_bins
    directions = jnp.floor(turns).astype(jnp.int32) % config.direction_bins
    counts = jnp.zeros((config.length_bins, config.direction_bins))
    counts = counts.at[lengths, directions].add(1.0, mode="drop")
    return jnp.fft.rfft(counts, axis=-1).T


def tolerant(counts: Array, tolerance: int) -> Array:
    """Counts summed over the bins within `tolerance` along the last axis."""
    bins = counts.shape[-1]
    padded = jnp.pad(counts, [(0, 0)] * (counts.ndim - 1) + [(tolerance, tolerance)])
    return sum(padded[..., shift : shift + bins] for shift in range(2 * tolerance + 1))  # pyright: ignore[reportReturnType]


def count_correspondences(
    queries: EdgeHistogram, references: EdgeHistogram, config: RelationConfig
) -> Float[Array, "queries references"]:
    """c_m of every query and reference: pairs of edges whose lengths are within tolerance."""
    return jnp.matmul(
        tolerant(queries.lengths, config.part_tolerance), references.lengths.T, precision=HIGHEST
    )


def preselection_quality(
    queries: EdgeHistogram, references: EdgeHistogram, config: RelationConfig
) -> Float[Array, "queries references"]:
    """q_m = c_m² / (k_act k_m) of paper 2.B; zero for graphs without edges."""
    count = count_correspondences(queries, references, config)
    edges = queries.edges[:, None] * references.edges[None, :]
    return jnp.where(edges > 0, count**2 / jnp.maximum(edges, 1.0), 0.0)


def matching_angles(
    queries: Complex[Array, "queries frequencies length_bins"],
    references: Complex[Array, "references frequencies length_bins"],
    config: RelationConfig,
) -> Float[Array, "queries references direction_bins"]:
    """Matching angle histograms of paper 2.C, of every query against every reference.

    From their `direction_spectrum`. Entry r counts the pairs of edges of corresponding length of
    which the reference's direction bin is r bins (modulo half a turn) past the query's. Whole
    numbers.
    """
    near = tolerant(queries, config.length_tolerance)
    product = jnp.einsum("qfl,mfl->qmf", jnp.conj(near), references, precision=HIGHEST)
    return jnp.round(jnp.fft.irfft(product, n=config.direction_bins, axis=-1))
