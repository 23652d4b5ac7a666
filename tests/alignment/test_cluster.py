import jax
import numpy as np
import pytest

from aprjax.alignment.cluster import (
    ClusterConfig,
    Contributions,
    centre_of_gravity,
    contributions,
)
from aprjax.alignment.correspondence import CorrespondenceConfig
from tests.oracles import alignment as oracle
from tests.relations.graphs import graph, moved, scattered

CONFIG = ClusterConfig()
SAME = CorrespondenceConfig()
CENTRE = np.float32([1.5, -0.7])

collect, unify = jax.jit(contributions), jax.jit(centre_of_gravity)


def place(pose):
    return moved(pose, [CENTRE])[0]


def given(poses, rotation, slots=12):
    """Contributions of the poses, in slots of which the rest is invalid."""
    turn, middle = np.full(slots, 0.0, np.float32), np.zeros((slots, 2), np.float32)
    for k, pose in enumerate(poses):
        turn[k], middle[k] = pose[2] - rotation, place(pose)
    return Contributions(turn=turn, middle=middle, valid=np.arange(slots) < len(poses))


def assert_pose(found, wanted, tolerance=1e-4):
    np.testing.assert_allclose(found[:2], wanted[:2], atol=tolerance)
    assert oracle.apart(float(found[2]), wanted[2], 2 * np.pi) <= tolerance


@pytest.mark.parametrize("seed", range(6))
def test_contributions_equal_the_loop(seed):
    rng = np.random.default_rng(seed)
    rotation = np.float32(rng.uniform(-3, 3))
    xy, order = scattered(seed, 9), rng.permutation(9)
    query = moved((1.0, 2.0, -rotation), xy[order]) + rng.normal(0, 0.03, (9, 2))
    reference, query = (xy, np.ones(9, bool)), (query.astype(np.float32), rng.random(9) < 0.8)
    for j in np.flatnonzero(query[1]):
        i = order[j]
        found = collect(
            graph(*reference), graph(*query), np.int32(i), np.int32(j), rotation, CENTRE, SAME
        )
        wanted = oracle.contributions(
            reference, query, i, j, float(SAME.length), float(rotation), float(SAME.angle)
        )
        assert set(np.flatnonzero(found.valid)) == set(wanted)
        assert len(wanted) >= 1
        for b, pose in wanted.items():
            gap = oracle.apart(float(found.turn[b]) + float(rotation), pose[2], 2 * np.pi)
            assert gap < 1e-4
            np.testing.assert_allclose(found.middle[b], place(pose), atol=1e-4)


@pytest.mark.parametrize("seed", range(6))
def test_the_centre_of_gravity_equals_the_loop(seed):
    rng = np.random.default_rng(seed)
    rotation = rng.uniform(-3, 3)
    true = np.array([rng.uniform(-5, 5), rng.uniform(-5, 5), rotation + 0.02])
    good = true + rng.normal(0, 1, (6, 3)) * [0.02, 0.02, 0.005]
    bad = true + rng.normal(0, 1, (4, 3)) * [2, 2, 0.05]
    poses = rng.permutation(np.concatenate([good, bad]))
    found, size = unify(given(poses, rotation), np.float32(rotation), CENTRE, CONFIG)
    wanted, count = oracle.centre_of_gravity(
        list(poses), CENTRE, float(CONFIG.distance), float(CONFIG.angle)
    )
    assert int(size) == count >= 6
    assert_pose(found, wanted, 1e-4)


def test_erroneous_contributions_are_dropped_not_averaged():
    good = [(2.0, 1.0, 0.5)] * 3
    poses = [*good, (9.0, 1.0, 0.5), (2.0, 1.0, 0.8)]
    found, size = unify(given(poses, 0.5), np.float32(0.5), CENTRE, CONFIG)
    assert int(size) == 3
    assert_pose(found, good[0])


def test_contributions_that_only_turn_differently_are_dropped():
    """The query's anchors come to lie about the same place, but turned by 0.15 rad."""
    found = given([(2.0, 1.0, 0.5)] * 4, 0.5)
    turn = found.turn + np.float32(0.15) * (np.arange(12) == 2)
    pose, size = unify(
        Contributions(turn=turn, middle=found.middle, valid=found.valid),
        np.float32(0.5),
        CENTRE,
        CONFIG,
    )
    assert int(size) == 3
    assert_pose(pose, (2.0, 1.0, 0.5))


def test_the_mean_is_more_precise_than_one_contribution():
    poses = [(2.0 + d, 1.0 - d, 0.5 + d / 2) for d in (-0.03, -0.01, 0.01, 0.03)]
    found, size = unify(given(poses, 0.5), np.float32(0.5), CENTRE, CONFIG)
    assert int(size) == 4
    assert_pose(found, (2.0, 1.0, 0.5), 1e-3)


@pytest.mark.parametrize("rotation", [np.pi, -np.pi, np.pi + 0.01, 3 * np.pi])
def test_a_cluster_about_half_a_turn_has_its_mean_there(rotation):
    poses = [(1.0, 1.0, rotation - 0.04), (1.0, 1.0, rotation + 0.04)]
    found, size = unify(given(poses, rotation), np.float32(rotation), CENTRE, CONFIG)
    assert int(size) == 2
    assert oracle.apart(float(found[2]), rotation, 2 * np.pi) < 1e-5
    assert abs(float(found[2])) <= np.float32(np.pi)


@pytest.mark.parametrize("count", [0, 1])
def test_no_or_one_contribution_gives_a_finite_pose_and_its_number(count):
    pose = (2.0, 1.0, 0.5)
    found, size = unify(given([pose] * count, 0.5), np.float32(0.5), CENTRE, CONFIG)
    assert int(size) == count
    assert np.isfinite(found).all()
    if count:
        assert_pose(found, pose)


def test_anchors_without_edges_contribute_nothing():
    empty = graph(scattered(0, 1))
    found = collect(empty, empty, np.int32(0), np.int32(0), np.float32(0), CENTRE, SAME)
    assert not np.asarray(found.valid).any()
    assert np.isfinite(found.turn).all()
    assert np.isfinite(found.middle).all()
