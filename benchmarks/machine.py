"""How fast the machine is at the moment, by work that has nothing to do with aprjax.

Figures of several machines, or of one that others use at the same time, are compared after
division by this.
"""

import os
import platform
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.timing import timed

NOMINAL = 0.010
"""Seconds that each probe takes on one core of the nominal machine, which has two."""
NOMINAL_CORES = 2

_SIZE = 4096  # XLA would share a larger array among the cores
_PLAIN_ROUNDS, _JITTED_ROUNDS = 120, 900  # some 10 ms each on a server


@dataclass(frozen=True)
class Probe:
    """Seconds of the fixed work."""

    numpy: float
    """Plain NumPy on one core: transcendental functions, a sort, a gather."""
    jax: float
    """The jitted kernel on one core: float32 arithmetic and gathers."""
    jax_all: float
    """The same, for each of as many calls at a time as there are cores; on an accelerator, one."""

    def slowness(self, cores: Literal["one", "all"]) -> float:
        """How many times as long as the nominal machine this one takes, on one core or on all."""
        if cores == "all":
            return self.jax_all / (NOMINAL / NOMINAL_CORES)
        return (self.numpy * self.jax) ** 0.5 / NOMINAL


@dataclass(frozen=True)
class Peak:
    """The most that the machine does with all its cores."""

    flops: float
    """float32 operations a second, in a matrix product."""
    bytes: float
    """Read and written a second, in a sum of arrays that no cache holds."""


def machine_name() -> str:
    """Device, cores and versions, in one line."""
    device = jax.devices()[0]
    kind = _cpu_model() if device.platform == "cpu" else device.device_kind
    return (
        f"{kind}, {device.platform}, {os.cpu_count()} cores, jax {jax.__version__}, "
        f"Python {platform.python_version()}"
    )


def probe(repeats: int = 15) -> Probe:
    """Medians of `repeats` runs each; about half a second in all."""
    threads = (os.cpu_count() or 1) if jax.default_backend() == "cpu" else 1
    values, index = _inputs()
    kernel = partial(_kernel, jnp.asarray(values), jnp.asarray(index))
    with ThreadPoolExecutor(threads) as pool:

        def on_all(_: int) -> None:
            list(pool.map(lambda _: jax.block_until_ready(kernel()), range(threads)))

        return Probe(
            numpy=float(np.median(timed(lambda _: _plain(values, index), repeats))),
            jax=float(np.median(timed(lambda _: kernel(), repeats))),
            jax_all=float(np.median(timed(on_all, repeats))) / threads,
        )


def peak(repeats: int = 7) -> Peak:
    """The best of `repeats` runs each."""
    size, length = 1024, 1 << 24
    square, long = jnp.ones((size, size)), jnp.ones(length)
    product = jax.jit(lambda a: jnp.matmul(a, a, precision="highest"))
    added = jax.jit(lambda a, b: a + b)
    return Peak(
        flops=2 * size**3 / timed(lambda _: product(square), repeats).min(),
        bytes=3 * long.nbytes / timed(lambda _: added(long, long), repeats).min(),
    )


def _inputs() -> tuple[np.ndarray, np.ndarray]:
    """Values, and places among them to gather from."""
    rng = np.random.default_rng(0)
    return rng.random(_SIZE, np.float32), rng.integers(0, _SIZE, _SIZE, np.int32)


def _plain(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    for _ in range(_PLAIN_ROUNDS):
        turned = np.sin(values) * values[index] + np.exp(-values)
        values = np.sort(turned)[index] / turned.max()
    return values


@jax.jit
def _kernel(values: jax.Array, index: jax.Array) -> jax.Array:
    def step(_, values):
        turned = values * values[index] + 0.5
        for _ in range(8):
            turned = turned * (1.5 - 0.5 * turned * turned)
        return jnp.minimum(turned, 1.0)

    return jax.lax.fori_loop(0, _JITTED_ROUNDS, step, values)


def _cpu_model() -> str:
    """What Linux calls the processor, else what Python does."""
    try:
        with open("/proc/cpuinfo") as file:  # noqa: PTH123
            lines = [line.split(":")[1].strip() for line in file if line.startswith("model name")]
    except OSError:
        lines = []
    return lines[0] if lines else platform.processor() or platform.machine()
