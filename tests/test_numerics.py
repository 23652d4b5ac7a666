import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.numerics import (
    arctan2,
    bucket,
    dot,
    first_max,
    in_parts,
    running_max,
    running_min_from_end,
    safe_arctan2,
    safe_norm,
    square_gaps,
    sums,
    total,
    wrap,
)

ANGLES = np.concatenate(
    [
        np.linspace(-20, 20, 401),
        *[np.nextafter(np.float32(k * np.pi), [-9, 9], dtype=np.float32) for k in (-2, -1, 0, 1)],
        [-np.pi, np.pi, 0.0, -1e-9, 1e-9],
    ]
).astype(np.float32)


@pytest.mark.parametrize("period", [2 * np.pi, np.pi])
def test_wrapping_shifts_by_whole_periods(period):
    turns = (np.asarray(wrap(jnp.asarray(ANGLES), period)) - ANGLES.astype(float)) / period
    np.testing.assert_allclose(turns, np.round(turns), atol=2e-6)


@pytest.mark.parametrize("period", [2 * np.pi, np.pi])
def test_wrapped_angles_lie_within_half_a_period(period):
    wrapped = np.asarray(wrap(jnp.asarray(ANGLES), period))
    half = np.float32(period / 2)
    assert (wrapped >= -half).all()
    assert (wrapped < half).all(), ANGLES[wrapped >= half]


def test_an_angle_wraps_to_itself_and_half_a_turn_to_its_negative():
    inside = np.linspace(-3.1, 3.1, 63).astype(np.float32)
    np.testing.assert_allclose(wrap(jnp.asarray(inside)), inside, atol=1e-6)
    assert float(wrap(jnp.float32(np.pi))) == np.float32(-np.pi)


@pytest.mark.parametrize("vector", [(0, 0), (3, -4), (1e-20, 0), (1e-4, 1e-4), (0, 2)])
def test_safe_norm_is_the_norm_with_a_finite_gradient(vector):
    value, slope = jax.value_and_grad(safe_norm)(jnp.asarray(vector, jnp.float32))
    np.testing.assert_allclose(value, np.hypot(*vector), rtol=1e-6, atol=1e-12)
    assert np.isfinite(slope).all()
    assert np.linalg.norm(slope) == pytest.approx(1.0 if value > 0 else 0.0, abs=1e-5)


@pytest.mark.parametrize("y", [0.0, -0.0, 1.0, -2.0])
@pytest.mark.parametrize("x", [0.0, -0.0, 1.0, -2.0])
def test_safe_arctan2_is_arctan2_with_a_finite_gradient(y, x):
    value, slope = jax.value_and_grad(safe_arctan2, argnums=(0, 1))(jnp.float32(y), jnp.float32(x))
    assert float(value) == pytest.approx(np.arctan2(y, x) if x or y else 0.0, abs=1e-6)
    square = x * x + y * y
    expected = (x / square, -y / square) if square else (0.0, 0.0)
    np.testing.assert_allclose(slope, expected, atol=1e-6)


def test_gradients_survive_padding_with_origins_in_a_batch():
    def total(points):
        return jnp.sum(safe_norm(points)) + jnp.sum(safe_arctan2(points[:, 1], points[:, 0]))

    slope = jax.jit(jax.grad(total))(jnp.zeros((4, 2)).at[0].set(jnp.array([3.0, 4.0])))
    assert np.isfinite(slope).all()
    assert not slope[1:].any()


def test_buckets_have_four_steps_to_the_octave():
    sizes = sorted({bucket(n) for n in range(70)})
    assert sizes == [8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 48, 56, 64, 80]


def test_a_bucket_holds_its_items_and_at_most_a_fifth_padding():
    for size in range(9, 6000):
        assert size <= bucket(size) <= size / 0.8
        assert bucket(bucket(size)) == bucket(size)


@pytest.mark.parametrize(("size", "smallest"), [(0, 8), (1, 8), (8, 8), (64, 64), (3, 64)])
def test_few_items_go_into_the_smallest_bucket(size, smallest):
    assert bucket(size, smallest) == smallest


def test_arctan2_is_that_of_numpy_in_every_direction_and_at_every_scale():
    angle = np.linspace(-np.pi, np.pi, 100_001)
    for scale in (1e-20, 1.0, 1e20):
        y, x = (scale * f(angle).astype(np.float32) for f in (np.sin, np.cos))
        wanted = np.arctan2(y.astype(float), x.astype(float))
        np.testing.assert_allclose(jax.jit(arctan2)(y, x), wanted, atol=4e-7)


@pytest.mark.parametrize(("y", "x"), [(0.0, 0.0), (0.0, -1.0), (-0.0, -1.0), (0.0, 1.0)])
def test_arctan2_on_the_axis_is_that_of_numpy(y, x):
    found = float(arctan2(jnp.float32(y), jnp.float32(x)))
    assert found == pytest.approx(np.arctan2(y, x), abs=1e-6)


@pytest.mark.parametrize("values", [[3.0], [1.0, 4.0, 4.0, 2.0], [-np.inf, -np.inf], [0.0, -0.0]])
def test_the_first_maximum_is_that_of_numpy(values):
    assert int(first_max(jnp.asarray(values, jnp.float32))) == np.argmax(values)


def test_products_totals_and_gaps_are_those_of_numpy():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 7, 2)).astype(np.float32)
    np.testing.assert_allclose(dot(a, b), np.sum(a * b, axis=-1), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(total(a), a.sum(axis=-1), rtol=1e-5, atol=1e-6)
    wanted = np.sum((a[:, None] - b[None]) ** 2, axis=-1)
    np.testing.assert_allclose(square_gaps(a, b), wanted, rtol=1e-5, atol=1e-6)


def test_sums_over_the_first_axis_are_those_of_numpy_mapped_or_not():
    terms = np.random.default_rng(0).normal(size=(3, 4, 7, 5)).astype(np.float32)
    mapped = jax.vmap(sums)(*terms)
    for k in range(3):
        np.testing.assert_allclose(sums(*terms[:, 0])[k], terms[k, 0].sum(axis=0), rtol=1e-5)
        np.testing.assert_allclose(mapped[k], terms[k].sum(axis=1), rtol=1e-5)


@pytest.mark.parametrize("rows", [1, 4, 5, 6])
def test_in_parts_is_as_all_at_once(rows):
    numbers = np.arange(3.0 * rows).reshape(rows, 3).astype(np.float32)

    def use(arrays):
        return jnp.sum(arrays[0], axis=1), arrays[1] + 1

    found = in_parts(use, (numbers, numbers[:, 0]))
    np.testing.assert_array_equal(found[0], numbers.sum(axis=1))
    np.testing.assert_array_equal(found[1], numbers[:, 0] + 1)


@pytest.mark.parametrize("size", [1, 2, 3, 8, 181])
def test_running_extremes_equal_numpys(size):
    values = np.random.default_rng(size).integers(-50, 50, size).astype(np.int32)
    greatest = running_max(jnp.asarray(values))
    least = running_min_from_end(jnp.asarray(values))
    np.testing.assert_array_equal(greatest, np.maximum.accumulate(values))
    np.testing.assert_array_equal(least, np.minimum.accumulate(values[::-1])[::-1])
