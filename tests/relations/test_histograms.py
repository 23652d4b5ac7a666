import jax
import numpy as np
import pytest

from aprjax.relations.histograms import (
    RelationConfig,
    count_correspondences,
    direction_spectrum,
    edge_histogram,
    matching_angles,
    preselection_quality,
    tolerant,
)
from aprjax.relations.index_table import IndexTable
from tests.oracles import relations as oracle
from tests.relations.graphs import graph, moved, scattered, stacked

COUNTS = [16, 12, 7, 3, 2, 1, 0, 16]
POINTS = [scattered(20 + k, count) for k, count in enumerate(COUNTS)]
POINTS[-1] = scattered(1, 16, size=30)  # most edges are too long to be counted
CONFIGS = {
    "default": RelationConfig(),
    "coarse": RelationConfig(bin_length=0.35, length_bins=40, direction_bins=24, parts=2),
    "whole bins": RelationConfig(parts=1),
    "exact bins": RelationConfig(length_tolerance=0, part_tolerance=0, parts=1),
    "wide": RelationConfig(length_tolerance=4, part_tolerance=5, direction_bins=45),
}

histograms = jax.jit(jax.vmap(edge_histogram, in_axes=(0, None)))
spectra = jax.jit(jax.vmap(direction_spectrum, in_axes=(0, None)))
counts_of, quality_of = jax.jit(count_correspondences), jax.jit(preselection_quality)
angles_of = jax.jit(matching_angles)


@pytest.fixture(scope="module")
def graphs():
    return stacked([jax.device_get(graph(xy)) for xy in POINTS])


def bins_of(graphs, k, config):
    """(length bin, direction bin) of the edges that take part, quantised edge by edge."""
    found = []
    for a in range(16):
        for b in range(a + 1, 16):
            length = int(np.floor(graphs.length[k, a, b] / np.float32(config.bin_length)))
            if graphs.valid[k, a, b] and length < config.length_bins:
                x, y = np.float64(graphs.unit[k, a, b])
                turn = np.arctan2(y, x) / np.pi * config.direction_bins
                found.append((length, int(np.floor(turn)) % config.direction_bins))
    return found


def quantised(graphs, config):
    """The number of each edge's part, the parts that count, and the index table of the numbers."""
    parts = np.floor(graphs.length / (np.float32(config.bin_length) / np.float32(config.parts)))
    counted = graphs.valid & (parts < config.parts * config.length_bins)
    return parts, counted, IndexTable.build(parts, counted)


@pytest.fixture(scope="module", params=CONFIGS)
def case(request, graphs):
    config = CONFIGS[request.param]
    return config, histograms(graphs, config)


def test_counts_equal_the_index_table_on_quantised_lengths(case, graphs):
    config, histogram = case
    found = np.asarray(counts_of(histogram, histogram, config))
    parts, counted, table = quantised(graphs, config)
    upper = np.triu_indices(16, 1)
    for k in range(len(POINTS)):
        wanted = table.counts(parts[k][upper][counted[k][upper]], config.part_tolerance)
        np.testing.assert_array_equal(found[k], wanted)


def test_counts_equal_the_double_loop_over_edges(case, graphs):
    config, histogram = case
    found = np.asarray(counts_of(histogram, histogram, config))
    parts, counted, _ = quantised(graphs, config)
    lengths = [parts[k][np.triu(counted[k], 1)].tolist() for k in range(len(POINTS))]
    for k, ours in enumerate(lengths):
        for m, theirs in enumerate(lengths):
            assert found[k, m] == oracle.count(ours, theirs, config.part_tolerance)


def test_qualities_equal_the_definition(case):
    config, histogram = case
    counts = np.asarray(counts_of(histogram, histogram, config))
    edges = [n * (n - 1) // 2 for n in COUNTS]
    wanted = [
        [oracle.quality(counts[k, m], edges[k], edges[m]) for m in range(len(COUNTS))]
        for k in range(len(COUNTS))
    ]
    np.testing.assert_allclose(quality_of(histogram, histogram, config), wanted, rtol=1e-6)


def test_matching_angles_equal_the_loop_over_pairs_of_edges(case, graphs):
    config, _ = case
    spectrum = spectra(graphs, config)
    found = np.asarray(angles_of(spectrum, spectrum, config))
    edges = [bins_of(graphs, k, config) for k in range(len(POINTS))]
    for k in (0, 1, 3, 5, 7):
        for m in (0, 2, 4, 6, 7):
            wanted = oracle.matching_angles(
                edges[k], edges[m], config.direction_bins, config.length_tolerance
            )
            np.testing.assert_array_equal(found[k, m], wanted)


@pytest.mark.parametrize("name", ["whole bins", "exact bins"])
def test_matching_angles_sum_to_the_counts(graphs, name):
    config = CONFIGS[name]
    histogram, spectrum = histograms(graphs, config), spectra(graphs, config)
    np.testing.assert_array_equal(
        np.sum(angles_of(spectrum, spectrum, config), axis=-1),
        counts_of(histogram, histogram, config),
    )


def test_edges_too_long_for_the_bins_are_still_counted_in_k(graphs):
    config = RelationConfig()
    histogram = histograms(graphs, config)
    assert np.asarray(histogram.edges).tolist() == [n * (n - 1) // 2 for n in COUNTS]
    assert float(histogram.lengths[-1].sum()) < float(histogram.edges[-1])


def test_graphs_without_edges_have_quality_zero_and_finite_histograms(graphs):
    config = RelationConfig()
    histogram = histograms(graphs, config)
    quality = np.asarray(quality_of(histogram, histogram, config))
    assert not quality[5].any()
    assert not quality[:, 6].any()
    for leaf in jax.tree.leaves((histogram, spectra(graphs, config))):
        assert np.isfinite(leaf).all()


def test_padding_filled_with_nan_changes_no_histogram():
    config = RelationConfig()
    pair = stacked([graph(POINTS[2]), graph(POINTS[2], fill=np.nan)])
    for leaf in jax.tree.leaves((histograms(pair, config), spectra(pair, config))):
        np.testing.assert_array_equal(leaf[0], leaf[1])


def test_a_mirror_image_has_the_same_quality_with_every_reference(graphs):
    config = RelationConfig()
    references = histograms(graphs, config)
    mirror = stacked([graph(xy * np.float32([1, -1])) for xy in POINTS])
    ours, theirs = (
        quality_of(queries, references, config)
        for queries in (references, histograms(mirror, config))
    )
    np.testing.assert_array_equal(ours, theirs)


def test_the_order_of_the_anchors_changes_nothing(graphs):
    config = RelationConfig()
    references = histograms(graphs, config)
    order = np.random.default_rng(0).permutation(16)
    shuffled = histograms(stacked([graph(POINTS[0][order])] * 8), config)
    np.testing.assert_array_equal(
        counts_of(shuffled, references, config)[0], counts_of(references, references, config)[0]
    )


@pytest.mark.parametrize("bins", [0, 1, 10, 31, 59])
def test_a_turned_graph_matches_at_its_rotation(graphs, bins):
    config = RelationConfig()
    turned = [graph(moved((1.0, -2.0, -bins * np.pi / 60), POINTS[1]))] * 8
    found = np.asarray(
        angles_of(spectra(stacked(turned), config), spectra(graphs, config), config)
    )[0, 1]
    width = found[np.arange(bins - 1, bins + 2) % 60]
    assert width.sum() >= 66  # every edge with itself
    assert found.argmax() in (np.arange(bins - 1, bins + 2) % 60)


def test_big_graphs_are_not_more_attractive_for_being_big(graphs):
    """A subgraph fits itself better than a big graph of accidental lengths (paper 2.B)."""
    config = CONFIGS["whole bins"]
    references = histograms(graphs, config)
    counts = np.asarray(counts_of(references, references, config))
    quality = np.asarray(quality_of(references, references, config))
    assert counts[3, 0] > counts[3, 3]
    assert quality[3, 3] > quality[3, 0]


@pytest.mark.parametrize("tolerance", [0, 1, 3])
def test_tolerant_counts_sum_over_neighbouring_bins(tolerance):
    counts = np.random.default_rng(0).integers(0, 5, (2, 9)).astype(np.float32)
    found = np.asarray(tolerant(counts, tolerance))
    for row in range(2):
        for k in range(9):
            assert found[row, k] == counts[row, max(0, k - tolerance) : k + tolerance + 1].sum()


def test_no_threshold_compiles_anew(graphs):
    traces = 0

    @jax.jit
    def run(graphs, config):
        nonlocal traces
        traces += 1
        return jax.vmap(edge_histogram, in_axes=(0, None))(graphs, config).lengths

    for width in (0.1, 0.2, np.float64(0.3)):
        run(graphs, RelationConfig(bin_length=width))
    assert traces == 1
