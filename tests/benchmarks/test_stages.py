import jax
import jax.numpy as jnp
import pytest

from benchmarks.stages import operations


def count(function, *arguments) -> float:
    return operations(jax.make_jaxpr(function)(*arguments).jaxpr)


def test_each_element_counts_and_moving_it_does_not():
    x = jnp.ones((4, 5))
    assert count(lambda x: x * x + 1.0, x) == 40
    assert count(lambda x: x.T.reshape(-1)[::2], x) == 0


def test_loops_count_as_often_as_they_run_also_inside_each_other():
    def inner(x):
        return jax.lax.fori_loop(0, 3, lambda _, y: y * 2.0, x)

    x = jnp.ones((7, 10))
    once = count(inner, x[0])
    assert 30 <= once <= 30 + 2 * 3  # and the counter's own steps
    assert count(lambda x: jax.lax.map(inner, x), x) == 7 * once


def test_products_sums_and_transforms():
    assert count(jnp.matmul, jnp.ones((2, 3)), jnp.ones((3, 4))) == 2 * 2 * 3 * 4
    assert count(jnp.sum, jnp.ones(9)) == 9
    assert count(jnp.fft.fft, jnp.ones(8, jnp.complex64)) == pytest.approx(5 * 3 * 8)
