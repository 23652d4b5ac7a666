from itertools import pairwise

import networkx as nx
import numpy as np
import pytest

from aprjax.plane import (
    compose,
    compose_covariance,
    inverse,
    inverse_covariance,
    relative,
)
from aprjax.world.model import WorldModel
from aprjax.world.parts import Arc, Place, WorldModelError
from aprjax.world.planning import PlanError, plan
from aprjax.world.relax import relax
from aprjax.world.super_space import assemble, between, connections, cycles, residuals

AHEAD = np.array([2.0, 0.0, np.pi / 2])


def torn(world: WorldModel, metres: float) -> None:
    """Make the arc that closes the square end beside its start."""
    world.replace_arc(
        Arc(3, 0, AHEAD + np.array([metres, 0, 0]), world.arc(3, 0).covariance, "closed")
    )


def test_poses_of_two_nodes_are_compared_along_the_arcs(square):
    one, other = Place(0, np.array([1.0, 0.0, 0.0])), Place(2, np.array([0.0, 0.0, 0.0]))
    T, covariance = between(square, one, other)
    np.testing.assert_allclose(T, [1.0, 2.0, -np.pi], atol=1e-9)
    # Two arcs' headings add up; the first one's turns the second about its corner.
    assert covariance[2, 2] == pytest.approx(2e-5)
    assert covariance[0, 0] == pytest.approx(2e-4 + 4 * 1e-5)
    assert covariance[1, 1] == pytest.approx(2e-4)
    back, _ = between(square, other, one)
    np.testing.assert_allclose(compose(T, back), 0, atol=1e-9)


def test_every_arc_adds_to_the_error(square):
    spread = {node: found.covariance[0, 0] for node, found in connections(square, 0).items()}
    assert spread[0] == 0 < spread[1] < spread[2]
    assert spread[3] < spread[2]  # along the closing arc
    assert 4 not in spread


def test_nodes_without_a_path_cannot_be_compared(square):
    with pytest.raises(WorldModelError, match="nodes 0 and 4: no path"):
        between(square, Place(0, np.zeros(3)), Place(4, np.zeros(3)))
    with pytest.raises(WorldModelError, match="node 9"):
        connections(square, 9)


def test_the_covariance_of_composed_and_inverted_poses_is_that_of_samples():
    rng = np.random.default_rng(0)
    T_a_b, T_b_c = np.array([1.0, -2.0, 0.7]), np.array([3.0, 0.5, -1.2])
    cov_a_b, cov_b_c = np.diag([4e-4, 1e-4, 2e-4]), np.diag([1e-4, 9e-4, 1e-4])
    first = rng.multivariate_normal(T_a_b, cov_a_b, 200_000)
    second = rng.multivariate_normal(T_b_c, cov_b_c, 200_000)
    sampled = np.cov(compose(first, second).T)
    claimed = compose_covariance(T_a_b, cov_a_b, T_b_c, cov_b_c)
    np.testing.assert_allclose(claimed, sampled, atol=3e-5)
    np.testing.assert_allclose(
        inverse_covariance(T_a_b, cov_a_b), np.cov(inverse(first).T), atol=3e-5
    )


def test_a_cycle_that_closes_is_not_torn_and_one_that_misses_its_start_is(square):
    (cycle,) = cycles(square)
    assert cycle.nodes == (0, 1, 2, 3)
    assert cycle.length == pytest.approx(8.0)
    np.testing.assert_allclose(cycle.T_residual, 0, atol=1e-9)
    assert not cycle.torn
    torn(square, 0.3)
    (cycle,) = cycles(square)
    assert np.hypot(*cycle.T_residual[:2]) == pytest.approx(0.3)
    assert cycle.torn
    square.remove_arc(3, 0)
    assert cycles(square) == []


def test_the_assembled_frame_is_torn_in_one_arc_and_the_relaxed_one_a_little_in_each(square):
    torn(square, 0.2)
    assembled, relaxed = (residuals(square, of(square)) for of in (assemble, relax))
    gaps = np.sort(np.hypot(*assembled[:, :2].T))
    assert gaps[-2] < 1e-6
    assert gaps[-1] > 0.15
    assert np.hypot(*relaxed[:, :2].T).max() < 0.1


def test_any_root_gives_the_same_frame_but_for_its_place(square):
    one, other = assemble(square, 0), assemble(square, 2)
    for node in range(4):
        np.testing.assert_allclose(
            relative(one[2], one[node]), other[node], atol=1e-9, err_msg=str(node)
        )
    relaxed = relax(square, 2)
    np.testing.assert_allclose(relaxed[2], 0, atol=1e-4)
    assert set(relaxed) == {0, 1, 2, 3}
    np.testing.assert_allclose(relaxed[0], other[0], atol=1e-3)


def test_an_arc_that_all_others_contradict_gives_way():
    world = WorldModel()
    sure = np.diag([1e-4, 1e-4, 1e-5])
    truth = [np.array([2.0 * k, 0.1 * k, 0.05 * k]) for k in range(6)]
    for _ in truth:
        world.add_node()
    for a in range(6):
        for b in range(a + 1, min(a + 3, 6)):
            world.add_arc(Arc(a, b, relative(truth[a], truth[b]), sure, "driven"))
    world.add_arc(Arc(0, 5, np.array([3.0, 4.0, 1.0]), sure, "closed"))
    relaxed = relax(world)
    np.testing.assert_allclose([relaxed[k] for k in range(6)], truth, atol=0.1)


def test_a_node_alone_is_a_frame(square):
    assert list(relax(square, 4)) == [4]


def test_a_path_is_the_shortest_and_says_how_to_turn(square):
    way = plan(square, 0, 2)
    assert way.length == pytest.approx(4.0)
    assert [(leg.start, leg.end) for leg in way.legs] in ([(0, 1), (1, 2)], [(0, 3), (3, 2)])
    # Round the square is to the left, the other way to the right.
    left = way.nodes[1] == 1
    assert way.legs[1].turn == pytest.approx(np.pi / 2 if left else -np.pi / 2)
    assert way.legs[0].turn == 0
    assert plan(square, 3, 3).legs == ()


def test_a_path_to_nowhere_is_a_clear_error(square):
    with pytest.raises(PlanError, match="node 4: no arcs lead there from 0"):
        plan(square, 0, 4)
    with pytest.raises(PlanError, match="node 7: the map has none, only 0 to 4"):
        plan(square, 7, 0)


def test_an_arc_longer_than_the_way_round_it_is_a_cycle_of_its_own(square):
    shortcut = np.array([9.0, 0.0, 0.0])
    # Added where networkx lists it before the arcs of the way round.
    square.remove_arc(2, 3)
    square.add_arc(Arc(0, 2, shortcut, square.arc(0, 1).covariance, "closed"))
    square.add_arc(Arc(2, 3, AHEAD, square.arc(0, 1).covariance, "driven"))
    whole, torn_one = cycles(square)
    assert whole.nodes == (0, 1, 2, 3)
    assert not whole.torn
    assert torn_one.torn
    assert torn_one.length == pytest.approx(4.0 + 9.0)


def test_a_stem_beside_a_torn_cycle_is_drawn_and_planned_as_it_was_measured(square):
    # Straight on where the way round turns left.
    ahead = np.array([2.0, 0.0, 0.0])
    square.add_arc(Arc(1, 4, np.array([0.0, -2.0, -np.pi / 2]), 0.01 * np.eye(3), "driven"))
    stem = square.add_node()
    square.add_arc(Arc(4, stem, ahead, 0.01 * np.eye(3), "driven"))
    torn(square, 0.4)
    off = residuals(square, relax(square))
    named = [(arc.a, arc.b) for arc in square.arcs()]
    np.testing.assert_allclose(off[[named.index((1, 4)), named.index((4, stem))]], 0, atol=1e-3)
    way = plan(square, 0, stem)
    assert way.nodes == (0, 1, 4, stem)
    np.testing.assert_allclose([leg.turn for leg in way.legs], [0, 0, 0], atol=1e-9)
    assert plan(square, stem, 2).legs[2].turn == pytest.approx(-np.pi / 2)


def test_where_a_process_allows_64_bits_the_relaxed_frame_is_the_same(square, wide):
    torn(square, 0.2)
    narrow = relax(square)
    wide()
    np.testing.assert_equal(relax(square), narrow)


SURE = np.diag([1e-4, 1e-4, 1e-5])


def tangle(seed: int) -> WorldModel:
    """A few nodes and arcs at random; nothing fits anything."""
    rng, world = np.random.default_rng(seed), WorldModel()
    count = int(rng.integers(5, 9))
    for _ in range(count):
        world.add_node()
    for a in range(count):
        for b in range(a + 1, count):
            if rng.random() < 0.45:
                T = np.array([rng.uniform(1, 10), 0, 0])
                world.add_arc(Arc(a, b, T, SURE * rng.uniform(0.1, 100), "driven"))
    return world


def test_a_node_within_reach_is_found_though_a_surer_way_there_is_too_long():
    world = WorldModel()
    for _ in range(4):
        world.add_node()
    for a, b, metres, covariance in ((0, 1, 5, 400 * SURE), (0, 2, 15, SURE), (2, 3, 15, SURE)):
        world.add_arc(Arc(a, b, np.array([metres, 0.0, 0.0]), covariance, "driven"))
    world.add_arc(Arc(3, 1, np.array([15.0, 0.0, 0.0]), SURE, "driven"))
    assert connections(world, 0)[1].path == (0, 2, 3, 1)
    near = connections(world, 0, 30.0)
    assert (near[1].path, near[1].length) == ((0, 1), 5.0)
    np.testing.assert_allclose(near[1].covariance, 400 * SURE)
    assert near[3].path == (0, 2, 3)
    assert set(connections(world, 0, 4.9)) == {0}


def test_all_nodes_within_reach_are_found_by_ways_within_reach():
    for seed in range(30):
        world = tangle(seed)
        metres = nx.Graph()
        metres.add_nodes_from(world.nodes)
        metres.add_weighted_edges_from((arc.a, arc.b, arc.length) for arc in world.arcs())
        for reach in (3.0, 8.0, 15.0, np.inf):
            for start in world.nodes:
                near = nx.single_source_dijkstra_path_length(metres, start, cutoff=reach)
                found = connections(world, start, reach)
                assert found.keys() == near.keys()
                for node, connection in found.items():
                    T = np.zeros(3)
                    for a, b in pairwise(connection.path):
                        T = compose(T, world.arc(a, b).T_a_b)
                    assert (connection.path[0], connection.path[-1]) == (start, node)
                    assert connection.length <= reach
                    np.testing.assert_allclose(connection.T_start_end, T, atol=1e-9)


def arcs_of(nodes) -> frozenset:
    return frozenset(frozenset(ends) for ends in pairwise([*nodes, nodes[0]]))


# In the first two, the longest arc between nodes with several others belongs to a cycle.
@pytest.mark.parametrize("seed", [187, 242, *range(20)])
@pytest.mark.parametrize("mixed", [False, True])
def test_cycles_are_those_of_networkx_however_torn_the_map_is(seed, mixed, monkeypatch):
    world = tangle(seed)
    lengths = nx.Graph()
    lengths.add_weighted_edges_from((arc.a, arc.b, arc.length) for arc in world.arcs())
    expected = nx.minimum_cycle_basis(lengths, weight="weight")
    if mixed:  # networkx promises no order of a cycle's nodes
        shuffled = [list(np.random.default_rng(0).permutation(nodes)) for nodes in expected]
        monkeypatch.setattr(nx, "minimum_cycle_basis", lambda *_, **__: shuffled)
    found = cycles(world)
    for cycle in found:
        assert cycle.nodes[0] == min(cycle.nodes)
        assert cycle.nodes[1] < cycle.nodes[-1]
        assert cycle.length == pytest.approx(
            sum(world.arc(a, b).length for a, b in pairwise([*cycle.nodes, cycle.nodes[0]]))
        )
    if mixed:
        assert {frozenset(cycle.nodes) for cycle in found} == set(map(frozenset, expected))
    else:
        assert {arcs_of(cycle.nodes) for cycle in found} == set(map(arcs_of, expected))


def test_a_model_without_nodes_has_no_frame():
    for frame in (assemble, relax):
        with pytest.raises(WorldModelError, match="world: there is no node"):
            frame(WorldModel())
