import numpy as np

from aprjax.world.model import WorldModel
from aprjax.world.motion import Motion
from aprjax.world.parts import Arc, Place
from aprjax.world.smoothing import Measurements
from aprjax.world.tidy import drop_small_cycles, merge_crossings, steady_frames

SURE = np.diag([1e-4, 1e-4, 1e-5])


def crossing(far: float) -> WorldModel:
    """A corridor 0-1-2, and arcs to 1 and 2 from node 3, `far` metres off in another corridor."""
    world = WorldModel()
    places = np.array([(-4.0, 0.0), (0.0, 0.0), (2.0, 0.0), (0.5, far)])
    for _ in places:
        world.add_node()
    for a, b in ((0, 1), (1, 2), (3, 1), (3, 2)):
        T = np.append(places[b] - places[a], 0.0)
        world.add_arc(Arc(a, b, T, SURE, "driven" if b != 2 else "closed"))
    return world


def test_a_crossing_is_no_cycle():
    world = crossing(far=3.0)
    drop_small_cycles(world, 12.0)
    assert [(arc.a, arc.b) for arc in world.arcs()] == [(0, 1), (1, 2), (3, 1)]


def test_a_way_round_something_stays_a_cycle():
    world = crossing(far=6.0)
    drop_small_cycles(world, 12.0)
    assert world.graph.number_of_edges() == 4


def crossing_of_two(gap: float) -> WorldModel:
    """Ways from node 0 to the left and down, and from node 1, `gap` metres on, right and up."""
    world = WorldModel()
    places = np.array([(0.0, 0.0), (gap, 0.0), (-4.0, 0.0), (0.0, -4.0), (gap + 4, 0), (gap, 4)])
    for _ in places:
        world.add_node()
    for a, b in ((0, 1), (0, 2), (0, 3), (1, 4), (1, 5)):
        world.add_arc(Arc(a, b, np.append(places[b] - places[a], 0.0), SURE, "driven"))
    return world


def test_a_crossing_that_two_nodes_share_is_made_one():
    world = crossing_of_two(gap=2.0)
    merge_crossings(world, 3.0, 0.4)
    assert sorted(world.graph[0]) == [2, 3, 4, 5]
    np.testing.assert_allclose(world.arc(0, 5).T_a_b, [2.0, 4.0, 0.0])


def test_crossings_farther_apart_and_nodes_on_a_way_stay_as_they_are():
    apart = crossing_of_two(gap=3.5)
    merge_crossings(apart, 3.0, 0.4)
    assert len(apart.nodes) == 6
    way = crossing(far=6.0)
    way.remove_arc(3, 2)
    merge_crossings(way, 3.0, 0.4)
    assert len(way.nodes) == 4


def test_a_scan_that_is_skewed_against_odometry_makes_no_frame():
    poses = np.array([[0.5 * scan, 0.0, 0.0] for scan in range(3)])

    def frame(*turns: float) -> int:
        world = WorldModel()
        world.add_node(0)
        for scan, pose in enumerate(poses):
            world.place_scan(scan, Place(0, pose))
        steps = np.array([[0.5, 0.0, turn] for turn in turns])
        measured = Measurements.make([0, 1], [1, 2], steps, np.tile(SURE, (2, 1, 1)))
        moved = Motion(poses, np.tile(SURE, (3, 1, 1)), poses[:, 0], measured)
        steady_frames(world, moved, dict.fromkeys(range(3), SURE))
        return world.graph.nodes[0]["scan"]

    assert frame(0.0, 0.0) == 1
    assert frame(0.5, 0.0) == 1  # an error of odometry's, which stays
    assert frame(-0.4, 0.4) != 1


def test_the_scan_whose_heading_is_held_best_makes_the_frame():
    poses = np.array([[0.1 * scan, 0.0, 0.0] for scan in range(5)])
    world = WorldModel()
    world.add_node(0)
    for scan, pose in enumerate(poses):
        world.place_scan(scan, Place(0, pose))
    steps = np.tile([0.1, 0.0, 0.0], (4, 1))
    covariances = SURE * np.array([4.0, 4.0, 4.0, 0.1])[:, None, None]
    measured = Measurements.make([0, 1, 2, 3], [1, 2, 3, 4], steps, covariances)
    moved = Motion(poses, np.tile(SURE, (5, 1, 1)), poses[:, 0], measured)
    steady_frames(world, moved, dict.fromkeys(range(5), SURE))
    assert world.graph.nodes[0]["scan"] == 3  # and not 2, in the middle
