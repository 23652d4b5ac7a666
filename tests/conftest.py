"""Settings and fixtures of the whole test session."""

import os
import tempfile
from pathlib import Path

import jax
import pytest

from aprjax import programs
from experiments.data import data_root


def pytest_configure(config):
    """Let the worker processes share what they compile, in a folder that goes with the session."""
    if not hasattr(config, "workerinput") and "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        folder = tempfile.TemporaryDirectory(prefix="aprjax-tests-", ignore_cleanup_errors=True)
        config.add_cleanup(folder.cleanup)
        os.environ["JAX_COMPILATION_CACHE_DIR"] = folder.name


@pytest.fixture(scope="session", autouse=True)
def _strict_jax():
    """Refuse silent promotion of dtypes and ranks: the engine spells both out."""
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture(scope="module", autouse=True)
def _room():
    """Forget what was compiled before `programs` would, in the midst of a test that counts."""
    yield
    if programs._crowded(0.5):
        jax.clear_caches()


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of the public logs."""
    root = data_root()
    if not (root / "logs").is_dir():
        pytest.skip(f"no logs folder in {root}; set APRJAX_DATA")
    return root


@pytest.fixture
def wide():
    """Called, it lets JAX make arrays of 64 bits, as a user's process may; until the test ends."""
    yield lambda: jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_enable_x64", False)


@pytest.fixture
def nans():
    """Lets a test put NaN on the device on purpose, also where `jax_debug_nans` is set."""
    with jax.debug_nans(False):
        yield
