"""Time of matching: `python -m benchmarks [SPLIT ...]`.

For each split of the real logs: all queries against all references as one batch (extraction of
the queries included), and one query at a time. Medians and spread after warm-up; the first call,
with compilation, apart. See `experiments/data.py` for where the data lie.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable

import jax
import numpy as np

import aprjax
from experiments.data import read_split

SPLITS = ("freiburg-079.revisit", "fhw.revisit", "intel.interleaved")


def main() -> int:
    """Print the table; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("splits", nargs="*", default=SPLITS, help="names of splits")
    parser.add_argument("--repeats", type=int, default=7, help="timed runs of a batch (default: 7)")
    arguments = parser.parse_args()

    print(f"{jax.devices()[0].device_kind}, {os.cpu_count()} cores, jax {jax.__version__}")
    print(f"{'split':26s} queries x references  first/s  batch/ms a query  µs a pair  single/ms")
    for name in arguments.splits:
        print(row(name, arguments.repeats), flush=True)
    return 0


def row(name: str, repeats: int) -> str:
    """One line of the table."""
    split = read_split(name)
    queries, references = len(split.T_world_query), len(split.T_world_ref)
    known = aprjax.ReferenceSet.build(split.references)
    one = jax.tree.map(lambda array: array[0], split.queries)
    first, batch = timed(lambda: aprjax.match_batch(split.queries, known), repeats)
    _, single = timed(lambda: aprjax.match(one, known), 20 * repeats)
    low, middle, high = np.percentile(1e3 * batch / queries, [10, 50, 90])
    pair = 1e3 * middle / references
    return (
        f"{name:26s} {queries:7d} x {references:<10d}  {first:7.1f}  "
        f"{middle:6.2f} ({low:.2f}-{high:.2f})  {pair:9.1f}  {1e3 * np.median(single):9.2f}"
    )


def timed(call: Callable[[], object], repeats: int) -> tuple[float, np.ndarray]:
    """Seconds of the first call, and of each of `repeats` after one more."""
    seconds = []
    for _ in range(repeats + 2):
        began = time.perf_counter()
        jax.block_until_ready(call())
        seconds.append(time.perf_counter() - began)
    return seconds[0], np.array(seconds[2:])


if __name__ == "__main__":
    sys.exit(main())
