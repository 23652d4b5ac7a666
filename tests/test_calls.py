"""Calls of one scan or of a chunk."""

import jax
import numpy as np
import pytest

from aprjax.calls import in_calls, rows_of, size_of_calls


@pytest.mark.parametrize(("count", "size"), [(1, 1), (5, 1), (23, 1), (24, 8), (25, 8), (1000, 8)])
def test_processors_share_single_scans_until_there_is_a_chunk_for_each(count, size, monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "cpu")
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    assert size_of_calls(count, 8) == size


@pytest.mark.parametrize(("count", "size"), [(0, 1), (1, 1), (2, 2), (5, 8), (8, 8), (1000, 8)])
def test_an_accelerator_takes_all_at_once_up_to_a_chunk(count, size, monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert size_of_calls(count, 8) == size


@pytest.mark.parametrize("count", [1, 3, 4, 9])
def test_every_scan_is_in_one_call_and_results_are_in_order(count, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    numbers = {"all": np.arange(count)}
    found = in_calls(lambda start: rows_of(numbers, slice(start, start + 3)), count, 3)
    np.testing.assert_array_equal(np.concatenate([each["all"] for each in found]), numbers["all"])


def test_what_one_call_raises_is_raised():
    def work(start):
        if start == 4:
            raise ValueError("the third")

    with pytest.raises(ValueError, match="the third"):
        in_calls(work, 8, 2)


def test_calls_compute_in_single_precision_on_every_thread():
    jax.config.update("jax_enable_x64", True)
    try:
        found = in_calls(lambda start: jax.numpy.asarray(1.5).dtype, 4, 1)
    finally:
        jax.config.update("jax_enable_x64", False)
    assert found == [np.float32] * 4


def test_calls_are_the_callers_as_to_device_and_precision_on_every_thread():
    device = jax.devices()[0]
    with jax.default_device(device), jax.default_matmul_precision("float32"):
        found = in_calls(lambda _: settings(), 3, 1)
    assert found == [(device, "float32")] * 3
    assert in_calls(lambda _: settings(), 3, 1) == [settings()] * 3


def settings():
    return jax.config.jax_default_device, jax.config.jax_default_matmul_precision
