import networkx as nx
import numpy as np
import pytest

from experiments.building import building, errand, lap, poses_along
from tests.worlds import clearance


@pytest.fixture(scope="module", params=[False, True])
def built(request):
    return building(4, shut=request.param)


def test_all_areas_are_connected_and_the_building_is_as_large_as_the_papers(built):
    assert nx.is_connected(built.plan.areas)
    width, height = np.ptp(built.plan.walls.reshape(-1, 2), axis=0)
    assert 45 < width < 55
    assert 65 < height < 75


def test_ways_keep_off_walls(built):
    ways = [lap(1, built, visits=2), lap(1, built, visits=1, clockwise=True)]
    ways += [errand(seed, built, 10.0) for seed in range(10)]
    for way in ways:
        for pose in poses_along(way, 0.4):
            assert clearance(built.plan.walls, pose[:2]) > 0.25


def test_a_robot_turns_on_the_spot_and_takes_even_steps():
    poses = poses_along([np.array(p) for p in ([0.0, 0.0], [2.0, 0.0], [2.0, 2.0])], 0.25)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T) + 0.5 * np.abs(np.diff(poses[:, 2]))
    np.testing.assert_allclose(steps, 0.25, atol=1e-9)
    np.testing.assert_allclose(poses[-1, 2], np.pi / 2)


def test_only_shut_corridors_are_blank_and_no_door_stands_out_there(built):
    assert (len(built.blank) == 2) == built.is_blank(np.array([[0.0, 12.0]]))[0]
    for low, high in built.blank:
        inside = np.all((built.plan.walls > low - 0.2) & (built.plan.walls < high + 0.2), axis=2)
        for wall in built.plan.walls[inside.all(axis=1)]:
            # Along y: the corridor's two sides.
            assert abs(wall[1, 0] - wall[0, 0]) < 1e-6
