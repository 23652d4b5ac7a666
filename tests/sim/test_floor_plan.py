import jax
import numpy as np
import pytest

from aprjax.sim.floor_plan import office
from aprjax.sim.ray_casting import cast
from aprjax.sim.structure import CLEARANCE
from tests.sim.plans import clearance_of

SEEDS = (0, 1, 2, 3)
cast_all = jax.jit(jax.vmap(cast, (None, 0, None)))


def surfaces(plan):
    world = plan.world()
    return np.asarray(world.segments), np.asarray(world.circles)


def inside_points(plan, rng, count):
    areas = [area["rectangle"] for _, area in plan.areas.nodes(data=True)]
    chosen = rng.integers(0, len(areas), count)
    return np.array([rng.uniform(*areas[i]) for i in chosen])


@pytest.mark.parametrize("seed", SEEDS)
def test_the_same_seed_gives_the_same_floor_and_another_seed_another(seed):
    first, again, other = office(seed), office(seed), office(seed + 100)
    for a, b in zip(surfaces(first), surfaces(again), strict=True):
        np.testing.assert_array_equal(a, b)
    assert surfaces(first)[0].shape != surfaces(other)[0].shape or not np.array_equal(
        surfaces(first)[0], surfaces(other)[0]
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_stands_in_the_robots_areas_nor_nearer_than_its_clearance(seed):
    rng = np.random.default_rng(seed)
    plan = office(seed)
    xy = inside_points(plan, rng, 400)
    for world in (plan.world(), plan.rearranged(seed + 50, 1.0).world()):
        assert clearance_of(world, xy).min() >= CLEARANCE - 1e-3


@pytest.mark.parametrize("seed", SEEDS)
def test_every_ray_from_inside_hits_something_within_the_building(seed):
    plan = office(seed)
    rng = np.random.default_rng(seed)
    xy = inside_points(plan, rng, 40)
    poses = np.concatenate([xy, np.zeros((len(xy), 1))], axis=1).astype(np.float32)
    bearings = np.linspace(-np.pi, np.pi, 720, endpoint=False).astype(np.float32)
    ranges = np.asarray(cast_all(plan.world(), poses, bearings))
    walls = plan.walls.reshape(-1, 2)
    assert ranges.max() <= np.hypot(*(walls.max(axis=0) - walls.min(axis=0)))


@pytest.mark.parametrize("seed", SEEDS)
def test_all_areas_can_be_reached_and_doors_lie_between_corridor_and_room(seed):
    areas = office(seed, visited=4).areas
    kinds = [area["kind"] for _, area in areas.nodes(data=True)]
    assert kinds.count("room") == kinds.count("door") == 4
    reached, todo = {0}, [0]
    while todo:
        for node in areas.neighbors(todo.pop()):
            if node not in reached:
                reached.add(node)
                todo.append(node)
    assert reached == set(areas.nodes)
    for node, area in areas.nodes(data=True):
        if area["kind"] == "door":
            assert {"corridor", "room"} <= {kinds[other] for other in areas.neighbors(node)}


def test_rearranging_moves_things_but_neither_walls_nor_areas():
    plan = office(1)
    later = plan.rearranged(7, 0.5)
    np.testing.assert_array_equal(plan.walls, later.walls)
    assert plan.areas is later.areas
    before, after = surfaces(plan), surfaces(later)
    assert before[0].shape != after[0].shape or not np.array_equal(before[0], after[0])
    for a, b in zip(surfaces(later), surfaces(plan.rearranged(7, 0.5)), strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(surfaces(plan), surfaces(plan.rearranged(7, 0.0)), strict=True):
        np.testing.assert_array_equal(a, b)


def test_clutter_adds_furniture():
    few, many = (len(office(2, clutter=clutter).furniture) for clutter in (0.0, 2.0))
    assert few < many


def test_impossible_floors_are_refused_by_name_and_value():
    for arguments, message in (
        ({"clutter": -1.0}, r"clutter: -1\.0"),
        ({"clutter": float("nan")}, "clutter: nan"),
        ({"visited": -2}, "visited: -2"),
    ):
        with pytest.raises(ValueError, match=message):
            office(0, **arguments)
    with pytest.raises(ValueError, match=r"share: 1\.5"):
        office(0).rearranged(0, 1.5)
