"""Result tables as CSV files."""

import csv
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from aprjax.atomic import atomic_write

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

HYPOTHESIS_COLUMNS = (
    "scan",
    "rank",
    "reference",
    "x",
    "y",
    "theta",
    "radius",
    "angle",
    "probability",
    "rest",
    "node",
    "situation",
)


@dataclass(frozen=True, eq=False)
class HypothesisRow:
    """One position hypothesis after one scan; without `reference`, that there is none."""

    scan: int
    rank: int
    """0 for the most probable hypothesis after this scan."""
    reference: int | None = None
    """Number of a scan in the log that the map was built from."""
    T_ref_laser: np.ndarray | None = None
    """`(3,)` in that scan's frame: metres, radians."""
    radius: float | None = None
    """r_i in metres."""
    angle: float | None = None
    """Δ_i in radians."""
    probability: float | None = None
    """λ_i."""
    rest: float = 1.0
    """λ_0."""
    node: int | None = None
    situation: str = ""


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


def write_hypotheses(path: str | os.PathLike[str], rows: Iterable[HypothesisRow]) -> None:
    """Write rows of position hypotheses, ordered by scan and rank.

    Floats have the fewest digits that read back as the same number, so that the probabilities of
    a scan still sum to one. Complete or not there: see `atomic_write`. Raises `OSError`.
    """
    with atomic_write(path) as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(HYPOTHESIS_COLUMNS)
        for row in rows:
            pose = [None] * 3 if row.T_ref_laser is None else row.T_ref_laser
            numbers = (*pose, row.radius, row.angle, row.probability, row.rest)
            table.writerow(
                (
                    row.scan,
                    row.rank,
                    row.reference,
                    *(None if number is None else repr(float(number)) for number in numbers),
                    row.node,
                    row.situation,
                )
            )


def _shortest(value: float) -> str:
    return np.format_float_positional(np.float32(value), unique=True, trim="0")
