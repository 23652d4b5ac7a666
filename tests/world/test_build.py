from dataclasses import replace

import networkx as nx
import numpy as np
import pytest

from aprjax.plane import distance, relative
from aprjax.scan import Scan
from aprjax.world.build import build_map
from aprjax.world.parts import Place
from aprjax.world.super_space import between, cycles, neighbourhood
from experiments.office import contracted
from tests.world.rings import LAP, drive


def test_a_ring_driven_once_and_a_half_is_one_cycle(built):
    world, _ = built
    assert nx.is_connected(world.graph)
    ring = contracted(world.graph)
    assert ring.number_of_nodes() == ring.number_of_edges() == 1
    (cycle,) = cycles(world)
    assert cycle.length == pytest.approx(LAP, rel=0.15)
    assert any(arc.kind == "closed" for arc in world.arcs())


def test_arcs_and_places_are_right_though_the_wheels_are_not(built):
    world, truth = built
    frames = {node: truth[world.graph.nodes[node]["scan"]] for node in world.nodes}
    for arc in world.arcs():
        off = relative(arc.T_a_b, relative(frames[arc.a], frames[arc.b]))
        assert distance(off) < 0.2
        assert abs(off[2]) < np.radians(3)
    assert sorted(world.places) == list(range(len(truth)))
    for scan, place in world.places.items():
        off = relative(place.T_node_laser, relative(frames[place.node], truth[scan]))
        assert distance(off) < 0.3
        assert distance(place.T_node_laser) < 10


def test_the_second_lap_is_placed_beside_the_first(built):
    world, truth = built
    lap = int(LAP / 0.5)
    right = 0
    for scan in range(lap + 10, len(truth)):
        earlier = world.places[scan - lap]
        assert len(neighbourhood(world, earlier.node, 3)) > 1
        T, _ = between(world, earlier, world.places[scan])
        off = relative(T, relative(truth[scan - lap], truth[scan]))
        right += distance(off) < 0.3
    assert right > 0.9 * (len(truth) - lap - 10)


def test_references_are_kept_where_they_add_something(built):
    world, truth = built
    scans = [seen.scan for seen in world.appearances.values()]
    assert len(scans) < 0.5 * len(truth)
    # Hardly any on the second lap, where there are some already.
    assert sum(scan > 1.2 * LAP / 0.5 for scan in scans) <= 4
    for seen in world.appearances.values():
        placed = world.places[seen.scan]
        assert seen.place.node == placed.node
        np.testing.assert_array_equal(seen.place.T_node_laser, placed.T_node_laser)
        assert world.arc_end(seen).neighbour is not None


def test_where_scans_show_nothing_in_common_the_map_claims_nothing():
    log, truth = drive(seed=3, way=24.0)
    # From before the first corner to behind the second one, and only odometry tells how.
    kept = [*range(20), *range(44, 48)]
    world = build_map([log[k] for k in kept])
    world.check()
    before, after = world.places[19].node, world.places[20].node
    assert not nx.has_path(world.graph, before, after)
    for scan, number in enumerate(kept):
        place = world.places[scan]
        frame = kept[world.graph.nodes[place.node]["scan"]]
        off = relative(place.T_node_laser, relative(truth[frame], truth[number]))
        assert distance(off) < 0.3


def test_a_log_without_scans_or_odometry_is_refused():
    log, _ = drive(seed=3, way=1.0)
    with pytest.raises(ValueError, match="there is no scan"):
        build_map([])
    with pytest.raises(ValueError, match="scan 1 has no odometry"):
        build_map([log[0], replace(log[1], odometry=None)])


@pytest.mark.parametrize("pose", [[0, np.nan, 0], [np.inf, 0, 0], [0, 0], [0, 2e15, 0]])
def test_odometry_that_is_no_pose_is_refused_by_the_number_of_its_scan(pose):
    log, _ = drive(seed=3, way=1.0)
    with pytest.raises(ValueError, match=r"scan 1: odometry \[.*\] is not three numbers"):
        build_map([log[0], replace(log[1], odometry=np.array(pose, float))])


@pytest.mark.parametrize("far", [1e4, 1e9, 9e14])
def test_odometry_that_jumps_out_of_the_world_spoils_no_place(far):
    log, truth = drive(seed=3, way=24.0)
    jump = np.array([far, 0.0, 0.0])
    world = build_map(
        [replace(log[k], odometry=log[k].odometry + jump * (k >= 12)) for k in range(24)]
    )
    world.check()
    assert len(world.places) == 24
    for scan, place in world.places.items():
        frame = world.graph.nodes[place.node]["scan"]
        off = relative(place.T_node_laser, relative(truth[frame], truth[scan]))
        assert distance(off) < 0.3


def test_one_scan_is_a_map_of_one_node():
    log, _ = drive(seed=3, way=0.5)
    few = Scan.make(
        log[0].scan.ranges[::3], angle_min=-np.pi / 2, angle_increment=np.pi / 60, range_max=30
    )
    world = build_map([replace(log[0], scan=few)])
    assert world.nodes == [0]
    assert isinstance(world.places[0], Place)
    assert len(world.appearances) == 1


def test_progress_is_told_of_every_scan_twice():
    log, _ = drive(seed=3, way=24.0)
    told: list[int] = []
    build_map(log[:24], progress=told.append)
    assert sum(told) == 2 * 24


def test_where_a_process_allows_64_bits_the_map_is_the_same(wide):
    log, _ = drive(seed=3, way=24.0)
    narrow = build_map(log[:24])
    wide()
    found = build_map(log[:24])
    assert found.places.keys() == narrow.places.keys()
    for scan, place in found.places.items():
        assert place.node == narrow.places[scan].node
        np.testing.assert_array_equal(place.T_node_laser, narrow.places[scan].T_node_laser)
