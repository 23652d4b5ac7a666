"""Time of matching: `python -m benchmarks [SPLIT ...]`.

For each split of the real logs: all queries against all references as one batch (extraction of
the queries included), and one query at a time. Medians and spread after warm-up; the first call,
with compilation, apart. The data are looked for in the folder `APRJAX_DATA`, else in
`../shared/data` beside the repository.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np

import aprjax

SPLITS = ("freiburg-079.revisit", "fhw.revisit", "intel.interleaved")


def main() -> int:
    """Print the table; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("splits", nargs="*", default=SPLITS, help="names of splits")
    parser.add_argument("--repeats", type=int, default=7, help="timed runs of a batch (default: 7)")
    arguments = parser.parse_args()
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("APRJAX_DATA", default)) / "splits"
    if not folder.is_dir():
        print(f"benchmarks: no splits in {folder}; set APRJAX_DATA", file=sys.stderr)
        return 1

    print(f"{jax.devices()[0].device_kind}, {os.cpu_count()} cores, jax {jax.__version__}")
    print(f"{'split':26s} queries x references  first/s  batch/ms a query  µs a pair  single/ms")
    for name in arguments.splits:
        print(row(folder / name, arguments.repeats), flush=True)
    return 0


def row(folder: Path, repeats: int) -> str:
    """One line of the table."""
    references = [entry.scan for entry in aprjax.read_log(folder / "references.log.gz")]
    scans = [entry.scan for entry in aprjax.read_log(folder / "queries.log.gz")]
    known = aprjax.ReferenceSet.build(references)
    stacked = aprjax.Scan.stack(scans)
    first, batch = timed(lambda: aprjax.match_batch(stacked, known), repeats)
    _, single = timed(lambda: aprjax.match(scans[0], known), 20 * repeats)
    low, middle, high = np.percentile(1e3 * batch / len(scans), [10, 50, 90])
    pair = 1e3 * middle / len(references)
    return (
        f"{folder.name:26s} {len(scans):7d} x {len(references):<10d}  {first:7.1f}  "
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
