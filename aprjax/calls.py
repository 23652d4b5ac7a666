"""Many scans in jitted calls of one or of a chunk, which fill the device and bound its memory."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import jax
import numpy as np

from aprjax.numerics import single_precision

CHUNK = 32
"""Scans of a call, at most, where no configuration says otherwise."""
_SETTINGS = ("jax_default_device", "jax_default_matmul_precision")
"""Of JAX, which a user may have set for a thread."""
_AHEAD = 2
"""Calls at a time on an accelerator: while it works on one, the host prepares the next."""

_Result = TypeVar("_Result")


def size_of_calls(count: int, most: int = CHUNK) -> int:
    """How many of `count` scans a call takes, `most` at most.

    A CPU's cores share the calls: it takes `most` where there are so many for each core, else one,
    so that there are two programs whatever the number of scans. An accelerator takes all of them
    at once, `most` at most, padded to a power of two.
    """
    if _on_cpu():
        return most if count >= _workers() * most else 1
    return min(most, 1 << max(count - 1, 0).bit_length())


def in_calls(work: Callable[[int], _Result], count: int, size: int) -> list[_Result]:
    """What `work` returns for each start of `size` scans, in order.

    It works in single precision; where there are several calls, in threads, with the device and the
    precision that are the caller's.
    """
    device, precision = (getattr(jax.config, name) for name in _SETTINGS)

    def alone(start: int) -> _Result:
        # Settings are the thread's, of which each has its own.
        with (
            single_precision(),
            jax.default_device(device),
            jax.default_matmul_precision(precision),
        ):
            return work(start)

    starts = range(0, count, size)
    if len(starts) == 1:
        return [alone(0)]
    # XLA runs the calls of one thread one after another, those of several at the same time.
    with ThreadPoolExecutor(_workers()) as pool:
        return list(pool.map(alone, starts))


def rows_of(stacked, rows):
    """Some rows of stacked scans or features, on the host."""
    return jax.tree.map(lambda array: np.asarray(array)[rows], stacked)


def _on_cpu() -> bool:
    return jax.default_backend() == "cpu"


def _workers() -> int:
    return (os.cpu_count() or 1) if _on_cpu() else _AHEAD
