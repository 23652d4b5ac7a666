"""What is matched: scans of the real logs (see `experiments/data.py` for where they lie)."""

from collections.abc import Iterator
from functools import cache

import jax
import numpy as np

import aprjax
from aprjax.metrics import NEAR_ANGLE, NEAR_DISTANCE
from aprjax.plane import distance, relative
from benchmarks.workload import Skipped
from experiments.data import Split, data_root, read_split


@cache
def split(name: str) -> Split:
    """A split of the logs, read once. Raises `Skipped` where the data are missing."""
    folder = data_root() / "splits" / name
    if not folder.is_dir():
        raise Skipped(f"{folder} is not there: set APRJAX_DATA to the folder of the logs")
    return read_split(name)


def some(scans: aprjax.Scan, rows: int | slice) -> aprjax.Scan:
    """One or some of stacked scans."""
    return jax.tree.map(lambda array: np.asarray(array)[rows], scans)


def end_points(scan: aprjax.Scan) -> np.ndarray:
    """The hits `(hits, 2)` of one scan, in metres."""
    return np.asarray(scan.points, float)[np.asarray(scan.hit)]


def true_pairs(from_: Split, count: int) -> Iterator[tuple[int, int, np.ndarray]]:
    """References and queries of one place, with `T_ref_query`: `count`, spread over the log.

    Of each query the reference taken nearest to it, of those turned less than `NEAR_ANGLE`.
    """
    T_ref_query = relative(from_.T_world_ref[:, None], from_.T_world_query[None])
    gap = distance(T_ref_query)
    gap[np.abs(T_ref_query[..., 2]) > NEAR_ANGLE] = np.inf
    able = np.flatnonzero(from_.mapped & (gap.min(axis=0) < NEAR_DISTANCE))
    for query in able[np.linspace(0, len(able) - 1, count).astype(int)].tolist():
        reference = int(np.argmin(gap[:, query]))
        yield reference, query, T_ref_query[reference, query]
