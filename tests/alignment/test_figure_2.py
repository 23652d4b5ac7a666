"""The example of the paper's Fig. 2, with all that its text states of it.

The picture is not at hand. Anchor points are numbered from 1, as there.
"""

from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.alignment.align import AlignmentConfig
from aprjax.alignment.cluster import ClusterConfig, centre_of_gravity, contributions
from aprjax.alignment.correspondence import CorrespondenceConfig, correspondence_matrices
from aprjax.alignment.rotation import RotationConfig, rotation_peaks
from experiments import worked_example
from experiments.worked_example import SAME_POINT, T_1_2
from tests.oracles.alignment import apart
from tests.relations.graphs import graph, moved

G_1 = dict(enumerate(map(tuple, worked_example.G_1), 1))
G_2 = dict(enumerate(map(tuple, worked_example.G_2), 1))

TRUE_PAIRS = {((1, 2), (2, 3)), ((1, 3), (1, 2)), ((2, 3), (1, 3))}
FALSE_PAIR = ((2, 4), (2, 3))

matrices, collect = jax.jit(correspondence_matrices), jax.jit(contributions)
unify, peaks_of = jax.jit(centre_of_gravity), jax.jit(rotation_peaks, static_argnums=1)

CONFIG = CorrespondenceConfig()
ANY_ANGLE = CorrespondenceConfig(angle=np.pi)
PEAK = np.radians(30)


def length(points, edge):
    return np.hypot(*np.subtract(points[edge[1]], points[edge[0]]))


def direction(points, edge):
    return np.arctan2(*np.subtract(points[edge[1]], points[edge[0]])[::-1])


def corresponding():
    """Pairs of edges of equal length, of G_1 and of G_2."""
    return {
        (e_1, e_2)
        for e_1 in combinations(G_1, 2)
        for e_2 in combinations(G_2, 2)
        if abs(length(G_1, e_1) - length(G_2, e_2)) <= float(CONFIG.length)
    }


@pytest.fixture(scope="module")
def graphs():
    return graph(list(G_1.values())), graph(list(G_2.values()))


def matrix(graphs, rotation, config):
    """The correspondence matrix with lines and columns numbered from 1."""
    rotations = jnp.array([rotation], jnp.float32)
    counts = np.asarray(matrices(*graphs, rotations, config))[0]
    assert not counts[4:].any()
    assert not counts[:, 3:].any()
    return {(i + 1, j + 1): int(counts[i, j]) for i in range(4) for j in range(3)}


def test_g_2_is_a_true_subgraph_of_the_larger_g_1():
    assert len(G_2) < len(G_1)
    for a, b in combinations(G_2, 2):
        in_g_1 = (SAME_POINT[a], SAME_POINT[b])
        assert length(G_2, (a, b)) == pytest.approx(length(G_1, in_g_1), abs=2e-4)
    np.testing.assert_allclose(
        moved(T_1_2, list(G_2.values())), [G_1[SAME_POINT[a]] for a in G_2], atol=2e-4
    )


def test_its_anchor_points_are_enumerated_differently():
    assert all(a != b for a, b in SAME_POINT.items())


def test_edges_1_2_and_2_4_of_g_1_are_as_long_as_2_3_of_g_2_and_all_others_differ():
    d = length(G_2, (2, 3))
    assert length(G_1, (1, 2)) == pytest.approx(d, abs=2e-4)
    assert length(G_1, (2, 4)) == pytest.approx(d, abs=2e-4)
    others = [length(G_1, e) for e in combinations(G_1, 2) if e not in {(1, 2), (2, 4)}]
    for one, other in combinations([d, *others], 2):
        assert abs(one - other) > 2 * float(CONFIG.length)


def test_there_are_three_correct_edge_correspondences_and_one_false():
    assert corresponding() == TRUE_PAIRS | {FALSE_PAIR}
    for (a, b), (v, w) in TRUE_PAIRS:
        assert {SAME_POINT[v], SAME_POINT[w]} == {a, b}


def test_each_edge_correspondence_increments_four_elements(graphs):
    wanted = dict.fromkeys(matrix(graphs, PEAK, ANY_ANGLE), 0)
    for (a, b), (v, w) in corresponding():
        for pair in ((a, v), (b, w), (a, w), (b, v)):
            wanted[pair] += 1
    assert matrix(graphs, PEAK, ANY_ANGLE) == wanted


def test_the_matrix_achieves_its_maximum_in_line_2_column_3(graphs):
    counts = matrix(graphs, PEAK, ANY_ANGLE)
    maximum = max(counts.values())
    assert [pair for pair, count in counts.items() if count == maximum] == [(2, 3)]
    assert SAME_POINT[3] == 2


def test_the_noise_to_signal_distance_is_not_satisfactory_without_the_angles(graphs):
    """The false pair raises elements to two thirds of the maximum."""
    counts = matrix(graphs, PEAK, ANY_ANGLE)
    false = [count for (i, j), count in counts.items() if SAME_POINT[j] != i]
    assert (max(counts.values()), max(false)) == (3, 2)


def test_three_correct_edge_correspondences_indicate_30_degrees():
    for e_1, e_2 in TRUE_PAIRS:
        turn = direction(G_1, e_1) - direction(G_2, e_2)
        assert apart(turn, np.radians(30), np.pi) < 1e-3


def test_the_false_pair_suggests_minus_45_degrees_modulo_180():
    turn = direction(G_1, FALSE_PAIR[0]) - direction(G_2, FALSE_PAIR[1])
    assert apart(turn, np.radians(-45), np.pi) < 1e-3


def test_the_matching_angle_histogram_counts_the_four_correspondences(alignment, graphs):
    histogram = alignment.histogram(*graphs)
    bins = np.arange(60)
    near_30 = np.minimum(np.abs(bins - 10), 60 - np.abs(bins - 10)) <= 1
    near_135 = np.abs(bins - 45) <= 1
    assert histogram[near_30].sum() == 3
    assert histogram[near_135].sum() == 1
    assert histogram.sum() == 4


def test_the_histograms_peak_is_the_most_likely_rotational_difference(alignment, graphs):
    rotations = peaks_of(jnp.asarray(alignment.histogram(*graphs)), RotationConfig(peaks=1))
    assert np.asarray(rotations.votes).tolist() == [3, 3]
    gaps = [apart(float(angle), PEAK, np.pi) for angle in rotations.angle]
    assert max(gaps) < np.radians(3)
    assert apart(*(float(a) for a in rotations.angle), 2 * np.pi) == pytest.approx(np.pi, abs=1e-5)


def test_the_false_pair_is_eliminated_by_the_matching_angle_histogram(graphs):
    """Within the peak the matrix holds the three true pairs' elements alone."""
    counts = matrix(graphs, PEAK, CONFIG)
    assert {pair for pair, count in counts.items() if count} == {
        (SAME_POINT[a], a) for a in SAME_POINT
    }
    assert set(counts.values()) == {0, 2}


def test_with_the_opposite_rotation_the_elements_are_the_other_ends(graphs):
    counts = matrix(graphs, PEAK + np.pi, CONFIG)
    wanted = dict.fromkeys(counts, 0)
    for (a, b), (v, w) in TRUE_PAIRS:
        for i, j in ((a, v), (b, w), (a, w), (b, v)):
            wanted[i, j] += SAME_POINT[j] != i
    assert counts == wanted
    assert max(counts.values()) == 1


def test_the_contributions_to_the_maximum_are_the_edges_at_2_and_3(graphs):
    """Three pairs contributed to line 2, column 3: two correct and similar, one erroneous."""
    arguments = (*graphs, jnp.int32(1), jnp.int32(2), jnp.float32(PEAK), jnp.zeros(2))
    found = collect(*arguments, ANY_ANGLE)
    assert set(np.flatnonzero(found.valid) + 1) == {1, 3, 4}
    turns = np.asarray(found.turn) + PEAK
    assert turns[0] == pytest.approx(np.radians(30), abs=1e-3)
    assert turns[2] == pytest.approx(np.radians(30), abs=1e-3)
    assert turns[3] == pytest.approx(np.radians(-45), abs=1e-3)


def test_the_erroneous_contribution_is_eliminated_by_the_clustering(graphs):
    centre, rotation = jnp.zeros(2), jnp.float32(PEAK)
    found = collect(*graphs, jnp.int32(1), jnp.int32(2), rotation, centre, ANY_ANGLE)
    pose, size = unify(found, rotation, centre, ClusterConfig())
    assert int(size) == 2
    np.testing.assert_allclose(pose, T_1_2, atol=1e-3)


def test_the_alignment_is_the_true_transformation(alignment, graphs):
    found = alignment(*graphs)
    assert found.valid[0]
    np.testing.assert_allclose(found.T_ref_query[0], T_1_2, atol=1e-3)
    assert found.anchors[0] == 3
    three = found.valid & (found.anchors == 3)
    for pose in found.T_ref_query[three]:
        np.testing.assert_allclose(pose, T_1_2, atol=1e-3)


def test_it_is_found_without_the_angles_too(alignment, graphs):
    found = alignment(*graphs, AlignmentConfig(correspondence=ANY_ANGLE))
    np.testing.assert_allclose(found.T_ref_query[0], T_1_2, atol=1e-3)
    assert found.votes[0] == 3


def test_exchanging_the_graphs_gives_the_inverse(alignment, graphs):
    found = alignment(*graphs[::-1])
    x, y, theta = found.T_ref_query[0]
    np.testing.assert_allclose(
        moved((x, y, theta), list(G_1.values()))[[2, 0, 1]], list(G_2.values()), atol=2e-3
    )
