import jax
import numpy as np
import pytest

from aprjax.evaluation.probability import ProbabilityConfig, probability

of = jax.jit(probability)


def test_the_probability_is_the_logistic_curve_over_the_logarithm_of_e_m():
    e_m = np.array([1e-6, 0.01, 0.1, 0.3, 1.0], np.float32)
    config = ProbabilityConfig(offset=9.0, slope=4.0)
    wanted = 1 / (1 + np.exp(-9.0) * e_m.astype(float) ** -4.0)
    np.testing.assert_allclose(of(e_m, config), wanted, rtol=1e-4)


def test_better_hypotheses_are_more_probable_and_none_has_no_probability():
    e_m = np.linspace(0, 1, 101, dtype=np.float32)
    found = np.asarray(of(e_m, ProbabilityConfig()))
    assert found[0] == 0
    assert (np.diff(found) >= 0).all()
    assert found[-1] == pytest.approx(1.0, abs=1e-4)


def test_gradients_are_finite_where_there_is_no_hypothesis():
    slope = jax.grad(lambda e_m: of(e_m, ProbabilityConfig()))(np.float32(0.0))
    assert slope == 0
