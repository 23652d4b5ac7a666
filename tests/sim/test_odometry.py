from itertools import pairwise

import numpy as np
import pytest

from aprjax.sim.odometry import OdometryConfig, odometry
from tests.oracles import evaluation as oracle

STEPS = 400


def way(seed=0):
    """Poses along a winding way, 0.1 m and up to 0.1 rad a step, and their stamps."""
    rng = np.random.default_rng(seed)
    pose, poses = np.array([3.0, -2.0, 1.0]), []
    for turn in rng.uniform(-0.1, 0.1, STEPS):
        poses.append(pose)
        pose = oracle.compose(pose, np.array([0.1, 0.0, turn]))
    return np.array(poses), 0.2 * np.arange(STEPS)


def only(**errors):
    exact = dict.fromkeys(OdometryConfig.__dataclass_fields__, 0.0)
    return OdometryConfig(**(exact | errors))


def test_without_error_odometry_and_gyro_restate_the_motion():
    poses, stamps = way()
    T_odom_robot, gyro = odometry(1, poses, stamps, OdometryConfig.exact())
    np.testing.assert_allclose(T_odom_robot[0], 0)
    for believed, true in zip(T_odom_robot, poses, strict=True):
        distance, angle = oracle.error(believed, oracle.between(poses[0], true))
        assert distance < 1e-9
        assert angle < 1e-9
    turn = np.mod(np.diff(poses[:, 2]) + np.pi, 2 * np.pi) - np.pi
    np.testing.assert_allclose(gyro, np.concatenate([[0], np.cumsum(turn)]), atol=1e-9)


def test_random_errors_have_the_spread_stated():
    poses, stamps = way()
    true = np.array([oracle.between(a, b) for a, b in pairwise(poses)])
    config = only(slip=0.05, sideways=0.02, heading=0.04)
    errors = []
    for seed in range(10):
        believed, _ = odometry(seed, poses, stamps, config)
        errors.append([oracle.between(a, b) for a, b in pairwise(believed)] - true)
    spread = np.concatenate(errors).std(axis=0)
    np.testing.assert_allclose(spread, np.array([0.05, 0.02, 0.04]) * np.sqrt(0.1), rtol=0.05)


def test_systematic_errors_are_the_same_in_every_step_and_others_in_every_run():
    stamps = 0.2 * np.arange(50)
    straight = np.stack([0.1 * np.arange(50), np.zeros(50), np.zeros(50)], axis=-1)
    scales = []
    for seed in range(200):
        believed, _ = odometry(seed, straight, stamps, only(scale=0.03))
        steps = np.diff(believed[:, 0])
        np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
        scales.append(steps[0] / 0.1 - 1)
    assert abs(np.std(scales) - 0.03) < 0.005


def test_the_gyro_drifts_by_its_bias_and_noise():
    still, stamps = np.zeros((STEPS, 3)), 0.2 * np.arange(STEPS)
    ends = [odometry(seed, still, stamps, only(gyro_bias=0.01))[1][-1] for seed in range(200)]
    assert abs(np.std(ends) / (0.01 * stamps[-1]) - 1) < 0.15
    ends = [odometry(seed, still, stamps, only(gyro_noise=0.01))[1][-1] for seed in range(200)]
    assert abs(np.std(ends) / (0.01 * np.sqrt(stamps[-1])) - 1) < 0.15


def test_the_same_seed_gives_the_same_errors():
    poses, stamps = way()
    for a, b in zip(odometry(3, poses, stamps), odometry(3, poses, stamps), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(odometry(3, poses, stamps)[0], odometry(4, poses, stamps)[0])


def test_bad_shapes_and_errors_are_refused_by_name_and_value():
    poses, stamps = way()
    with pytest.raises(ValueError, match=r"T_world_robot: shape \(400, 2\)"):
        odometry(0, poses[:, :2], stamps)
    with pytest.raises(ValueError, match=r"stamps: shape \(399,\) does not fit 400"):
        odometry(0, poses, stamps[1:])
    with pytest.raises(ValueError, match=r"slip: -1\.0"):
        OdometryConfig(slip=-1.0)
