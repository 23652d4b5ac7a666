import numpy as np

from aprjax.plane import (
    compose,
    compose_covariance,
    distance,
    inverse,
    inverse_covariance,
    relative,
    transform,
    wrap,
)

RNG = np.random.default_rng(1)
A, B = RNG.normal(0, 3, (2, 5, 3))


def motion(pose):
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0, 0, 1]])


def test_a_relative_pose_undoes_the_composition():
    for a, b, T_a_b in zip(A, B, relative(A, B), strict=True):
        np.testing.assert_allclose(motion(a) @ motion(T_a_b), motion(b), atol=1e-12)
        assert -np.pi <= T_a_b[2] < np.pi
    again = compose(A, relative(A, B))
    np.testing.assert_allclose(again[:, :2], B[:, :2], atol=1e-12)
    np.testing.assert_allclose(again[:, 2], wrap(B[:, 2]), atol=1e-12)


def test_poses_are_composed_as_matrices_are_multiplied_whatever_broadcasts():
    expected = [motion(a) @ motion(b) for a, b in zip(A, B, strict=True)]
    for found, true in zip(compose(A, B), expected, strict=True):
        np.testing.assert_allclose(motion(found), true, atol=1e-12)
    np.testing.assert_array_equal(compose(A[0], B), compose(np.tile(A[0], (5, 1)), B))


def test_a_pose_and_its_inverse_lead_nowhere():
    np.testing.assert_allclose(compose(A, inverse(A)), np.zeros((5, 3)), atol=1e-12)


def test_points_are_moved_as_poses_are():
    xy = RNG.normal(0, 3, (5, 7, 2))
    moved = transform(A[:, None], xy)
    poses = np.concatenate([xy, np.zeros((5, 7, 1))], axis=-1)
    np.testing.assert_array_equal(moved, compose(A[:, None], poses)[..., :2])
    np.testing.assert_array_equal(transform(A[0], xy[0]), moved[0])


def test_distances_are_those_of_origins():
    np.testing.assert_allclose(distance(inverse(A)), distance(A))


def test_covariances_are_those_of_small_errors():
    # Errors of a millionth: what the composition makes of them is linear.
    errors = 1e-6 * RNG.normal(size=(2, 20_000, 3)) @ np.diag([1.0, 2.0, 0.5])
    covariance = np.diag([1.0, 4.0, 0.25])
    both = compose(A[0] + errors[0], B[0] + errors[1]) - compose(A[0], B[0])
    np.testing.assert_allclose(
        compose_covariance(A[0], covariance, B[0], covariance), np.cov(both.T) / 1e-12, atol=0.9
    )
    back = inverse(A[0] + errors[0]) - inverse(A[0])
    np.testing.assert_allclose(
        inverse_covariance(A[0], covariance), np.cov(back.T) / 1e-12, atol=0.5
    )
