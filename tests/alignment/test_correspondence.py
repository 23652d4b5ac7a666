import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.alignment.correspondence import CorrespondenceConfig, correspondence_matrices
from tests.oracles import alignment as oracle
from tests.relations.graphs import graph, moved, scattered

CONFIG = CorrespondenceConfig()
LENGTH, ANGLE = float(CONFIG.length), float(CONFIG.angle)
ANY_ANGLE = CorrespondenceConfig(angle=np.pi)

matrices = jax.jit(correspondence_matrices)


def matrix(reference, query, rotation=0.0, config=CONFIG):
    rotations = jnp.array([rotation, rotation + 1.0], jnp.float32)
    return np.asarray(matrices(reference, query, rotations, config))[0]


def pair(seed, n=9, m=7):
    """A graph, and a moved part of it with noise and some points more; `(xy, valid)` each."""
    rng = np.random.default_rng(seed)
    reference = scattered(seed, n)
    order = rng.permutation(n)[: m - 2]
    rotation = rng.uniform(-3, 3)
    query = moved((1.0, 2.0, -rotation), reference[order]) + rng.normal(0, 0.03, (m - 2, 2))
    query = np.concatenate([query, rng.uniform(-6, 6, (2, 2))]).astype(np.float32)
    return (reference, rng.random(n) < 0.9), (query, rng.random(m) < 0.9), rotation


@pytest.mark.parametrize("seed", range(5))
def test_the_matrix_without_the_angles_equals_the_papers_loop(seed):
    reference, query, rotation = pair(seed)
    found = matrix(graph(*reference), graph(*query), rotation, ANY_ANGLE)
    np.testing.assert_array_equal(found[:9, :7], oracle.paper_matrix(reference, query, LENGTH))
    assert not found[9:].any()
    assert not found[:, 7:].any()


@pytest.mark.parametrize("seed", range(5))
def test_the_matrix_of_a_rotation_equals_the_loop(seed):
    reference, query, rotation = pair(seed)
    for angle in (rotation, rotation + np.pi, 0.4):
        found = matrix(graph(*reference), graph(*query), angle)[:9, :7]
        wanted = oracle.directed_matrix(reference, query, LENGTH, angle, ANGLE)
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("seed", range(5))
def test_both_half_turns_together_are_the_papers_matrix_of_the_histogram_peak(seed):
    reference, query, rotation = pair(seed)
    graphs = graph(*reference), graph(*query)
    both = matrix(*graphs, rotation) + matrix(*graphs, rotation + np.pi)
    wanted = oracle.paper_matrix(reference, query, LENGTH, rotation, ANGLE)
    np.testing.assert_array_equal(both[:9, :7], wanted)


def test_each_rotation_has_the_matrix_that_it_has_alone():
    reference, query, rotation = pair(3)
    graphs = graph(*reference), graph(*query)
    angles = np.array([rotation, 0.3, rotation + np.pi, -1.0], np.float32)
    together = np.asarray(matrices(*graphs, angles, CONFIG))
    for k, angle in enumerate(angles):
        np.testing.assert_array_equal(together[k], matrix(*graphs, angle))


def test_the_true_pairs_have_the_highest_entries():
    xy, rotation = scattered(11, 8), 0.6
    query = moved((1.0, -2.0, -rotation), xy)
    found = matrix(graph(xy), graph(query), rotation)[:8, :8]
    assert (found.diagonal() >= 7).all()
    assert found[~np.eye(8, dtype=bool)].max() < 7


@pytest.mark.parametrize("seed", range(3))
def test_permuting_anchors_permutes_the_matrix(seed):
    reference, query, rotation = pair(seed)
    rng = np.random.default_rng(seed)
    n, m = rng.permutation(9), rng.permutation(7)
    before = matrix(graph(*reference), graph(*query), rotation)[:9, :7]
    shuffled = [tuple(part[order] for part in it) for it, order in ((reference, n), (query, m))]
    after = matrix(graph(*shuffled[0]), graph(*shuffled[1]), rotation)[:9, :7]
    np.testing.assert_array_equal(after, before[np.ix_(n, m)])


def test_exchanging_the_graphs_transposes_the_matrix():
    reference, query, rotation = pair(1)
    there = matrix(graph(*reference), graph(*query), rotation)
    back = matrix(graph(*query), graph(*reference), -rotation)
    np.testing.assert_array_equal(there, back.T)


def test_whole_turns_change_nothing():
    reference, query, rotation = pair(2)
    graphs = graph(*reference), graph(*query)
    np.testing.assert_array_equal(matrix(*graphs, rotation), matrix(*graphs, rotation - 2 * np.pi))


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("fill", [0.0, np.nan])
def test_few_anchors_and_padding_count_nothing(count, fill):
    xy = scattered(1, count)
    found = matrix(graph(xy, fill=fill), graph(xy, fill=fill))
    wanted = np.zeros((16, 16))
    if count == 2:
        wanted[[0, 1], [0, 1]] = 1
    np.testing.assert_array_equal(found, wanted)


def test_masked_anchors_count_nothing():
    xy = scattered(1, 9)
    assert not matrix(graph(xy), graph(xy, np.zeros(9, bool))).any()
