"""Wall-clock time of calls."""

import time
from collections.abc import Callable

import jax
import numpy as np


def timed(call: Callable[[int], object], repeats: int, warm_up: int = 2) -> np.ndarray:
    """Seconds `(repeats,)` of `call(0)`, `call(1)`, … until their results are there.

    The `warm_up` calls before them, which count from 0 too, compile and fill caches.
    """
    for index in range(warm_up):
        jax.block_until_ready(call(index))
    seconds = np.empty(repeats)
    for index in range(repeats):
        began = time.perf_counter()
        jax.block_until_ready(call(index))
        seconds[index] = time.perf_counter() - began
    return seconds
