"""Result tables as CSV files."""

import csv
import os
from collections.abc import Sequence

import numpy as np

from aprjax.io.atomic import atomic_write

MATCH_COLUMNS = (
    "query",
    "rank",
    "reference",
    "x",
    "y",
    "theta",
    "quality",
    "preselection",
    "status",
    "anchors",
    "beams",
    "probability",
)


def write_matches(
    path: str | os.PathLike[str],
    *,
    reference: np.ndarray,
    pose: np.ndarray,
    quality: np.ndarray,
    preselection: np.ndarray,
    valid: np.ndarray,
    status: Sequence[str],
    agreeing_anchors: np.ndarray,
    agreeing_beams: np.ndarray,
    probability: np.ndarray,
) -> None:
    """Write Q queries with up to K hypotheses each, best first, one row per valid hypothesis.

    `pose` `(Q, K, 3)` is `T_ref_query` in metres and radians; `status` holds Q names; all else is
    `(Q, K)`. The query and the reference are numbers of scans, from 0. A query without a valid
    hypothesis has one row of rank 0 that states only its status. Floats have the fewest digits
    that read back as the same float32. The file is complete or not there: see `atomic_write`.

    Raises `ValueError` naming an array whose shape does not fit the others, and `OSError`.
    """
    shape = np.shape(valid)
    if len(shape) != 2:
        raise ValueError(f"valid: shape {shape} is not (queries, hypotheses)")
    for name, value, expected in (
        ("reference", reference, shape),
        ("pose", pose, (*shape, 3)),
        ("quality", quality, shape),
        ("preselection", preselection, shape),
        ("status", status, shape[:1]),
        ("agreeing_anchors", agreeing_anchors, shape),
        ("agreeing_beams", agreeing_beams, shape),
        ("probability", probability, shape),
    ):
        if np.shape(value) != expected:
            raise ValueError(f"{name}: shape {np.shape(value)} is not {expected}")
    with atomic_write(path) as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(MATCH_COLUMNS)
        for query, outcome in enumerate(status):
            hypotheses = np.flatnonzero(valid[query])
            for rank, k in enumerate(hypotheses):
                numbers = (*pose[query, k], quality[query, k], preselection[query, k])
                table.writerow(
                    (
                        query,
                        rank,
                        int(reference[query, k]),
                        *map(_shortest, numbers),
                        outcome,
                        int(agreeing_anchors[query, k]),
                        int(agreeing_beams[query, k]),
                        _shortest(probability[query, k]),
                    )
                )
            if not hypotheses.size:
                table.writerow((query, 0, *[""] * 6, outcome, "", "", ""))


def _shortest(value: float) -> str:
    return np.format_float_positional(np.float32(value), unique=True, trim="0")
