"""Places that look alike are all named and none is called certain; one distinct object decides.

Every world is made of identical cells, with references in some of them. The matcher knows no pose
of a reference unless it is told. Scans have noise of 1 cm and see all around.
"""

from itertools import pairwise

import jax
import numpy as np
import pytest

from aprjax.batch import match_batch
from aprjax.matcher import MatchConfig
from aprjax.metrics import deviations, world_poses
from aprjax.references import ReferenceSet
from aprjax.status import Status
from tests.oracles.evaluation import compose
from tests.worlds import scan_at

MANY = MatchConfig(hypotheses=16)
"""More than there are places that look alike, in every world here."""
NEAR = 0.1, np.radians(2)
"""Metres and radians between a hypothesis and the place that it names."""
QUARTERS, HALVES = np.pi / 2 * np.arange(4), np.pi * np.arange(2)
PERIOD = 4.0  # metres between doors
SEEDS = range(3)


# Worlds


def polyline(*points):
    return np.array(list(pairwise(points)), float)


def box(x, y, width, depth):
    w, d = width / 2, depth / 2
    corners = (x - w, y - d), (x + w, y - d), (x + w, y + d), (x - w, y + d)
    return polyline(*corners, corners[0])


def corridor(sides, doors=6):
    """2 m wide along x; every `PERIOD` metres, a door's niche in the walls of the `sides`."""
    ends = -6.0, PERIOD * (doors - 1) + 6
    parts = [polyline((x, -1), (x, 1)) for x in ends]
    for side in (-1, 1):
        front, back = side * 1.0, side * 2.2
        wall = [(ends[0], front)]
        for x in PERIOD * np.arange(doors) if side in sides else ():
            wall += [(x - 0.5, front), (x - 0.5, back), (x + 0.5, back), (x + 0.5, front)]
        parts.append(polyline(*wall, (ends[1], front)))
    return np.concatenate(parts)


def hall(cells=7, size=5.0):
    """Square cells of `size` metres in a square, each with a pillar in its middle."""
    middles = size * (np.arange(cells) + 0.5)
    pillars = [box(x, y, 0.8, 0.5) for x in middles for y in middles]
    return np.concatenate([box(cells * size / 2, cells * size / 2, *2 * [cells * size]), *pillars])


ROOM = box(0, 0, 6, 6)
IN_ROOM = np.array([(0.4, 0.3, 0.5), (-1, -1, 2), (1, 1.5, -1.5), (1.2, -1.2, 0.3)])
DOORS = np.array([(PERIOD * i, 0, 0) for i in range(6)])
CROSSINGS = np.array([(5.0 * i, 5.0 * j, 0) for i in (2, 3, 4) for j in (2, 3)])
"""Corners of the hall's cells."""


# What is found in them


def located(world, places, queries, range_max, seed, posed=False):
    """The result of `queries`, with references at `places`, and the poses `(Q, K, 3)` it gives.

    The matcher is told the references' poses if `posed`.
    """
    rng = np.random.default_rng(seed)

    def take(poses):
        fov = 2 * np.pi * 360 / 361
        return [scan_at(world, pose, 361, fov, 0.01, rng, range_max) for pose in poses]

    references = ReferenceSet.build(take(places), T_world_ref=places if posed else None)
    result = jax.tree.map(np.asarray, match_batch(take(queries), references, MANY))
    return result, world_poses(result, references.ids, places)


def offsets(seed, count, sideways):
    """Poses `(count, 3)` within 0.5 m of a cell's middle along x and `sideways` metres across."""
    limits = 0.5, sideways, np.pi
    return np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * limits


def alike(cells, offset, turns=(0.0,)):
    """Poses that look as `offset` in each of the `cells` does, which look the same turned."""
    return np.array(
        [compose(cell, compose([0, 0, turn], offset)) for cell in cells for turn in turns]
    )


def is_near(poses, others):
    gap, turn = deviations(poses, others)
    return (gap < NEAR[0]) & (turn < NEAR[1])


def assert_all_named(result, poses, query, expected):
    """Every pose of `expected` `(P, 3)` is among the hypotheses of a query, as good as the best."""
    quality = result.quality[query]
    equal = result.valid[query] & (quality > 0.7 * quality[0])
    assert np.all(np.any(is_near(poses[query], expected[:, None]) & equal, axis=1))


def assert_ambiguous(result):
    np.testing.assert_array_equal(result.status, Status.AMBIGUOUS)
    assert not result.confident.any()


def assert_certain(result, poses, truth):
    assert np.all(is_near(poses[:, 0], truth))
    assert Status.AMBIGUOUS not in result.status
    assert result.confident.all()


# A square room


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("places", [1, 4])
def test_a_square_room_gives_all_four_symmetric_poses_and_no_certain_answer(places, seed):
    queries = offsets(seed, 4, 1.5)
    result, poses = located(ROOM, IN_ROOM[:places], queries, 30.0, seed)
    for query, pose in enumerate(queries):
        assert_all_named(result, poses, query, alike(np.zeros((1, 3)), pose, QUARTERS))
    assert_ambiguous(result)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("places", [1, 4])
def test_a_cupboard_makes_the_answer_in_a_square_room_single_right_and_certain(places, seed):
    queries = offsets(seed, 4, 1.5)
    world = np.concatenate([ROOM, box(2.2, -1.2, 1.0, 0.8)])
    result, poses = located(world, IN_ROOM[:places], queries, 30.0, seed)
    assert_certain(result, poses, queries)


# A corridor


@pytest.mark.parametrize("seed", SEEDS)
def test_doors_that_face_each_other_are_all_named_either_way_round_and_none_is_certain(seed):
    off = offsets(seed, 4, 0.4)
    result, poses = located(corridor((-1, 1)), DOORS, DOORS[1:5] + off, 5.0, seed)
    for query in range(4):
        assert_all_named(result, poses, query, alike(DOORS, off[query], HALVES))
    assert_ambiguous(result)


@pytest.mark.parametrize("seed", SEEDS)
def test_doors_on_one_side_are_all_named(seed):
    """They are not called ambiguous unless poses are known: the references contradict nothing."""
    off = offsets(seed, 4, 0.4)
    result, poses = located(corridor((1,)), DOORS, DOORS[1:5] + off, 5.0, seed)
    for query in range(4):
        assert_all_named(result, poses, query, alike(DOORS, off[query]))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("sides", [(1,), (-1, 1)])
def test_a_cupboard_between_two_doors_makes_the_answer_at_both_right_and_certain(sides, seed):
    queries = DOORS[[2, 3, 2, 3]] + offsets(seed, 4, 0.4)
    world = np.concatenate([corridor(sides), box(2.5 * PERIOD, -0.75, 0.9, 0.5)])
    result, poses = located(world, DOORS, queries, 5.0, seed)
    assert_certain(result, poses, queries)


@pytest.mark.parametrize("seed", SEEDS)
def test_with_known_poses_none_of_the_doors_on_one_side_is_certain(seed):
    off = offsets(seed, 4, 0.4)
    result, poses = located(corridor((1,)), DOORS, DOORS[1:5] + off, 5.0, seed, posed=True)
    for query in range(4):
        assert_all_named(result, poses, query, alike(DOORS, off[query]))
    assert_ambiguous(result)


@pytest.mark.parametrize("seed", SEEDS)
def test_with_known_poses_doors_away_from_a_cupboard_are_not_certain(seed):
    """The cupboard is at doors 2 and 3 alone; the queries are at doors 0, 1, 4 and 5."""
    queries = DOORS[[0, 1, 4, 5]] + offsets(seed, 4, 0.4)
    world = np.concatenate([corridor((1,)), box(2.5 * PERIOD, -0.75, 0.9, 0.5)])
    result, poses = located(world, DOORS, queries, 4.0, seed, posed=True)
    for query, pose in enumerate(queries - DOORS[[0, 1, 4, 5]]):
        assert_all_named(result, poses, query, alike(DOORS[[0, 1, 4, 5]], pose))
    assert not result.confident.any()


@pytest.mark.parametrize("seed", SEEDS)
def test_with_known_poses_a_cupboard_still_makes_the_answer_certain(seed):
    queries = DOORS[[2, 3, 2, 3]] + offsets(seed, 4, 0.4)
    world = np.concatenate([corridor((1,)), box(2.5 * PERIOD, -0.75, 0.9, 0.5)])
    result, poses = located(world, DOORS, queries, 5.0, seed, posed=True)
    assert_certain(result, poses, queries)


# A hall


@pytest.mark.parametrize("seed", SEEDS)
def test_crossings_between_pillars_are_all_named_either_way_round_and_none_is_certain(seed):
    off = offsets(seed, 4, 0.5)
    result, poses = located(hall(), CROSSINGS, CROSSINGS[[0, 2, 3, 5]] + off, 6.0, seed)
    for query in range(4):
        assert_all_named(result, poses, query, alike(CROSSINGS, off[query], HALVES))
    assert_ambiguous(result)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_screen_beside_a_crossing_makes_the_answer_there_right_and_certain(seed):
    queries = CROSSINGS[3] + offsets(seed, 4, 0.5)
    world = np.concatenate([hall(), box(14.2, 17.0, 3.0, 0.2)])
    result, poses = located(world, CROSSINGS, queries, 6.0, seed)
    assert_certain(result, poses, queries)


@pytest.mark.parametrize("seed", SEEDS)
def test_with_known_poses_the_two_sides_of_a_screen_are_both_named_and_neither_is_certain(seed):
    """The world is the same turned half about the screen's middle, between two references."""
    off = offsets(seed, 4, 0.5)
    world = np.concatenate([hall(), box(15.0, 12.5, 2.0, 0.2)])
    queries = CROSSINGS[3] + off
    result, poses = located(world, CROSSINGS, queries, 6.0, seed, posed=True)
    other = CROSSINGS[2] + (0, 0, np.pi)
    for query in range(4):
        expected = np.concatenate([alike(CROSSINGS[3:4], off[query]), alike([other], off[query])])
        assert_all_named(result, poses, query, expected)
    assert_ambiguous(result)
