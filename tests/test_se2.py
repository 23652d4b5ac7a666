import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax import se2

compose, inverse = jax.jit(se2.compose), jax.jit(se2.inverse)
transform = jax.jit(se2.transform)

BATCHES = [(), (1,), (3, 1, 2)]
SCALES = [1.0, 1e-4]  # far from the identity and near it


def pose(seed, batch, scale):
    rng = np.random.default_rng(seed)
    spread = np.array([5.0, 5.0, 3.0]) * scale
    return jnp.asarray(rng.uniform(-spread, spread, (*batch, 3)), jnp.float32)


def matrix(pose):
    """Homogeneous matrices in float64."""
    x, y, theta = np.moveaxis(np.asarray(pose, np.float64), -1, 0)
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = [
        [np.cos(theta), -np.sin(theta), x],
        [np.sin(theta), np.cos(theta), y],
        [zero, zero, one],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def assert_same_motion(a, b, atol=2e-6):
    assert np.shape(a) == np.shape(b)
    np.testing.assert_allclose(matrix(a), matrix(b), atol=atol)


@pytest.fixture(params=BATCHES, ids=str)
def batch(request):
    return request.param


@pytest.fixture(params=SCALES)
def poses(request, batch):
    return [pose(seed, batch, request.param) for seed in range(3)]


def test_composition_is_the_matrix_product(poses):
    a, b, _ = poses
    np.testing.assert_allclose(matrix(compose(a, b)), matrix(a) @ matrix(b), atol=4e-6)


def test_composition_is_associative(poses):
    a, b, c = poses
    left = compose(compose(a, b), c)
    assert_same_motion(left, compose(a, compose(b, c)), atol=6e-6)


def test_zero_is_the_identity_on_both_sides(poses):
    a, identity = poses[0], jnp.zeros_like(poses[0])
    assert_same_motion(compose(a, identity), a)
    assert_same_motion(compose(identity, a), a)


def test_the_inverse_undoes_on_both_sides(poses):
    a = poses[0]
    identity = jnp.zeros_like(a)
    assert_same_motion(compose(a, inverse(a)), identity, atol=6e-6)
    assert_same_motion(compose(inverse(a), a), identity, atol=6e-6)
    assert_same_motion(inverse(inverse(a)), a, atol=6e-6)


def test_the_inverse_of_a_product_is_the_product_of_inverses_reversed(poses):
    a, b, _ = poses
    turned = compose(inverse(b), inverse(a))
    assert_same_motion(inverse(compose(a, b)), turned, atol=8e-6)


def test_points_move_as_poses_compose(poses):
    a, b, _ = poses
    points = jnp.asarray(np.random.default_rng(9).normal(size=(*a.shape[:-1], 4, 2)), jnp.float32)
    step_by_step = transform(a, transform(b, points))
    np.testing.assert_allclose(transform(compose(a, b), points), step_by_step, atol=1e-5)
    back = transform(inverse(a), transform(a, points))
    np.testing.assert_allclose(back, points, atol=1e-5)


def test_the_origin_of_b_lies_at_the_translation_of_t_a_b(poses):
    a = poses[0]
    origin = jnp.zeros((*a.shape[:-1], 1, 2))
    np.testing.assert_allclose(transform(a, origin)[..., 0, :], a[..., :2], atol=1e-7)


def test_composed_angles_stay_within_half_a_turn():
    angle = jnp.asarray(np.linspace(-3.14, 3.14, 41), jnp.float32)
    a = jnp.stack([jnp.zeros_like(angle)] * 2 + [angle], axis=-1)
    product = compose(a[:, None] + jnp.zeros((1, 41, 1)), a[None, :] + jnp.zeros((41, 1, 1)))
    assert (np.abs(product[..., 2]) <= np.float32(np.pi)).all()
    np.testing.assert_allclose(
        np.exp(1j * np.asarray(product[..., 2])),
        np.exp(1j * (np.asarray(angle)[:, None] + np.asarray(angle))),
        atol=2e-6,
    )


def test_rotation_is_counter_clockwise():
    np.testing.assert_allclose(
        se2.rotate(jnp.array([1.0, 0.0]), jnp.float32(np.pi / 2)), [0.0, 1.0], atol=1e-6
    )


def test_a_quarter_turn_at_2_1_puts_the_point_ahead_to_the_left():
    T_a_b = jnp.array([2.0, 1.0, np.pi / 2])
    np.testing.assert_allclose(transform(T_a_b, jnp.array([[3.0, 0.0]])), [[2.0, 4.0]], atol=1e-6)


def test_gradients_are_finite_at_the_identity():
    jacobian = jax.jit(jax.jacobian(lambda p: compose(p, inverse(p))))(jnp.zeros(3))
    np.testing.assert_allclose(jacobian, np.zeros((3, 3)), atol=1e-6)
