import networkx as nx
import numpy as np
import pytest

from aprjax.plane import relative
from aprjax.world.motion import Motion
from aprjax.world.parts import Place
from aprjax.world.smoothing import Measurements
from aprjax.world.super_space import assemble
from experiments.map_scores import frame_rms, pair_errors, score_map
from experiments.office import contracted, corridors, outline, walls, way


def truth_of(world) -> np.ndarray:
    """Poses of the scans 0 to 40 of the square, its nodes' among them, as its arcs have them."""
    frame = assemble(world)
    truth = np.zeros((41, 3))
    for scan in range(41):
        node = min(scan // 10, 3)
        world.place_scan(scan, Place(node, np.zeros(3)))
        truth[scan] = frame[node]
    world.graph.remove_node(4)
    return truth


def test_a_true_map_has_no_errors(square):
    truth = truth_of(square)
    figures = score_map(square, truth)
    assert figures["false_arcs"] == figures["false_places"] == 0
    assert figures["arc_m_95"] == pytest.approx(0, abs=1e-9)
    assert (figures["nodes"], figures["arcs"], figures["closed"]) == (4, 4, 1)
    assert frame_rms(square, assemble(square), truth + np.array([3.0, -2.0, 0.0])) == pytest.approx(
        0, abs=1e-9
    )


def test_wrong_arcs_and_places_are_counted(square):
    truth = truth_of(square)
    truth[20, 2] += np.radians(16)  # the frame of node 2
    figures = score_map(square, truth)
    assert figures["false_arcs"] == 2
    # Of the scans 20 to 29 all but that of the frame itself.
    assert figures["false_places"] == pytest.approx(9 / 41)


def test_a_lap_that_is_driven_again_is_recognized_where_the_map_joins_it(built):
    world, truth = built
    figures = score_map(world, truth)
    assert figures["false_arcs"] == 0
    assert figures["revisits"] > 20
    # All but the scans of the first metres, which are needed as evidence.
    assert figures["recognized"] > 0.8


def test_the_outline_of_two_rooms_with_a_door_is_one_wall():
    rooms = np.array([[(0, 0), (2, 3)], [(2, 1), (2.5, 2)], [(2.5, 0), (4, 3)]], float)
    faces = outline(rooms)
    lengths = np.abs(faces[:, 1] - faces[:, 0]).sum(axis=1)
    assert lengths.sum() == pytest.approx(2 * (2 + 3) + 2 * (1.5 + 3) - 2 * 1 + 2 * 0.5)
    assert len(faces) == 12


def test_the_office_has_five_cycles_and_every_turn_in_it_is_driven():
    graph = corridors(quick=False)
    assert graph.number_of_edges() - len(graph) + 1 == 5
    assert nx.is_strongly_connected(graph)
    assert min(degree for _, degree in contracted(graph.to_undirected()).degree()) == 3
    passed = way(0, graph)
    turns = set(zip(passed[:-2], passed[1:-1], passed[2:], strict=True))
    assert turns == {(a, b, c) for a, b in graph.edges for c in graph.successors(b)}
    spans = np.ptp(walls(0, graph).reshape(-1, 2), axis=0)
    assert np.all(spans > (50, 70))


def test_errors_of_the_truth_show_in_all_pairs_of_a_scan_and_not_in_what_they_say_together():
    poses = np.array([[0.5 * scan, 0.0, 0.0] for scan in range(4)])
    first, second = np.array([0, 1, 2, 0, 1, 2, 0, 1]), np.array([1, 2, 3, 1, 2, 3, 2, 3])
    steps = relative(poses[first], poses[second])
    measured = Measurements.make(first, second, steps, np.tile(1e-4 * np.eye(3), (8, 1, 1)))
    moved = Motion(poses, np.zeros((4, 3, 3)), poses[:, 0], measured)
    truth = poses + [0, 0, 1] * np.radians([[0.0], [2.0], [0.0], [-2.0]])
    errors = pair_errors(moved, truth)
    assert errors["pair_deg_true"] == pytest.approx(2.0)
    assert errors["pair_deg"] == pytest.approx(0.0)
