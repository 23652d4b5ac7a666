import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.anchors.extract import Anchors
from aprjax.relations.graph import anchor_graph
from tests.oracles import relations as oracle
from tests.relations.graphs import graph, moved, scattered


@pytest.mark.parametrize("count", [0, 1, 2, 3, 9, 16])
def test_edges_equal_the_loop(count):
    xy = scattered(count, count)
    found = graph(xy)
    edges = oracle.edges(xy, np.ones(count, bool))
    assert int(found.edges) == len(edges) == count * (count - 1) // 2
    for a, b, length, direction in edges:
        assert bool(found.valid[a, b])
        assert float(found.length[a, b]) == pytest.approx(length, abs=1e-5)
        unit = np.array([np.cos(direction), np.sin(direction)])
        assert abs(float(found.unit[a, b] @ unit)) == pytest.approx(1, abs=1e-5)
        np.testing.assert_allclose(found.unit[a, b] * length, xy[b] - xy[a], atol=1e-5)


def test_an_edge_occurs_in_both_senses():
    found = graph(scattered(0, 9))
    np.testing.assert_array_equal(found.length, found.length.T)
    np.testing.assert_array_equal(found.valid, found.valid.T)
    np.testing.assert_array_equal(found.unit, -np.swapaxes(found.unit, 0, 1))
    assert not np.asarray(found.valid).diagonal().any()


def test_invalid_anchors_have_no_edges():
    xy = scattered(1, 6)
    valid = np.array([True, False, True, True, False, True])
    found = graph(xy, valid)
    assert int(found.edges) == 6
    assert not np.asarray(found.valid)[~np.pad(valid, (0, 10))].any()


def test_duplicate_anchors_have_no_edge_between_them():
    found = graph([(1, 2), (1, 2), (3, 4)])
    assert int(found.edges) == 2
    assert np.isfinite(found.unit).all()


@pytest.mark.parametrize("count", [0, 1, 2, 5])
@pytest.mark.parametrize("fill", [0.0, np.nan, np.inf])
def test_a_graph_is_finite_whatever_its_padding_holds(count, fill):
    xy = scattered(2, count)
    found, clean = graph(xy, fill=fill), graph(xy)
    for leaf in jax.tree.leaves(found):
        assert np.isfinite(leaf).all()
    for leaf, other in zip(jax.tree.leaves(found), jax.tree.leaves(clean), strict=True):
        np.testing.assert_array_equal(leaf, other)


def test_lengths_do_not_change_under_a_motion_and_directions_turn_with_it():
    xy, pose = scattered(3, 8), (2.0, -1.0, 0.7)
    before, after = graph(xy), graph(moved(pose, xy))
    np.testing.assert_allclose(before.length, after.length, atol=1e-5)
    real = np.asarray(before.valid)
    turned = moved((0, 0, 0.7), np.asarray(before.unit)[real])
    np.testing.assert_allclose(turned, np.asarray(after.unit)[real], atol=1e-5)


def test_lengths_of_a_mirror_image_are_the_same_to_the_bit():
    xy = scattered(4, 8)
    np.testing.assert_array_equal(graph(xy).length, graph(xy * np.float32([1, -1])).length)


@pytest.mark.parametrize("points", [np.zeros((4, 2)), [(0, 0), (1, 1), (1, 1), (3, 0)]])
def test_gradients_are_finite_with_padding_and_duplicates(points):
    def total(xy):
        zeros = jnp.zeros(4)
        valid = jnp.array([True, True, True, False])
        found = anchor_graph(Anchors(xy, zeros.astype(int), zeros, valid, jnp.int32(0)))
        return jnp.sum(found.length) + jnp.sum(found.unit**2)

    assert np.isfinite(jax.jit(jax.grad(total))(jnp.asarray(points, jnp.float32))).all()
