import numpy as np
import pytest

from aprjax.anchors.candidates import Kind
from tests.anchors.shapes import box, distance_to, points_of, polyline, room, seen_from, turn_at

ROOM = room(6, 5)
CORNERS = ROOM[:, 0]


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("seed", range(3))
def test_the_corners_of_a_room_are_virtual_edges(extraction, seed, noise):
    rng = np.random.default_rng(seed)
    pose = (*rng.uniform(-1, 1, 2), rng.uniform(-3, 3))
    found = points_of(extraction(turn_at(ROOM, pose, noise=noise, seed=seed)).virtual_edges)
    for corner in seen_from(pose, CORNERS):
        assert distance_to(found, corner) < 0.03


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("seed", range(3))
def test_a_corner_hidden_by_an_object_is_found_to_a_few_centimetres(extraction, seed, noise):
    rng = np.random.default_rng(seed)
    pose = (*rng.uniform(-0.8, 0.5, 2), rng.uniform(-3, 3))
    world = np.concatenate([ROOM, polyline((3, 1.4), (2.2, 1.6), (2.0, 2.5))])
    stages = extraction(turn_at(world, pose, noise=noise, seed=seed))
    hidden = seen_from(pose, (3, 2.5))
    assert distance_to(points_of(stages.virtual_edges), hidden) < 0.04
    assert distance_to(points_of(stages.anchors, Kind.VIRTUAL_EDGE), hidden) < 0.04
    assert distance_to(points_of(stages.angles), hidden) > 0.5


def test_a_wall_in_pieces_is_one_line(extraction):
    """Cupboards stand before the wall at x = 3; its elongation still meets the others."""
    world = np.concatenate([ROOM, box(2.7, 1.0, 0.6), box(2.7, -0.9, 0.6)])
    found = points_of(extraction(turn_at(world, (-1.0, 0.1, 0.0))).anchors, Kind.VIRTUAL_EDGE)
    for corner in ((4.0, 2.4), (4.0, -2.6)):
        assert distance_to(found, corner) < 0.04


def test_parallel_walls_do_not_meet(extraction):
    corridor = np.concatenate([polyline((-9, 1), (9, 1)), polyline((-9, -1), (9, -1))])
    for noise in (0.0, 0.01):
        found = extraction(turn_at(corridor, (0.0, 0.2, 0.7), noise=noise)).virtual_edges
        assert not found.valid.any()


def test_one_wall_meets_nothing(extraction):
    found = extraction(turn_at(polyline((2, -3), (2, 3)), np.zeros(3), noise=0.01)).virtual_edges
    assert not found.valid.any()


def test_small_surfaces_and_walls_far_from_each_other_do_not_meet(extraction):
    short = np.concatenate([polyline((2, -3), (2, 3)), polyline((1, 2.6), (1.4, 2.6))])
    far = np.concatenate([polyline((2, -3), (2, 0)), polyline((-9, 5), (-6, 5))])
    for world in (short, far):
        assert not extraction(turn_at(world, np.zeros(3))).virtual_edges.valid.any()
