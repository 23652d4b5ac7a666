"""What a sweep found: its tables and pictures."""

import csv
import importlib
import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from aprjax.atomic import atomic_write
from aprjax.metrics import Answers, best_answers
from aprjax.plot.sweep import QualityCurve, draw_quality_curves, draw_sweep
from aprjax.result import MatchResult
from aprjax.sweeping.axes import product

Truth = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""The references' ids, true poses `(references, 3)` and `(queries, 3)`, and which are mapped."""

_DPI = 110


def write_rows(
    out: Path,
    axes: Mapping[str, np.ndarray],
    result: MatchResult,
    truth: Truth,
    false_rate: float,
) -> tuple[list[dict[str, Any]], list[Answers]]:
    """`sweep.csv`, a row for each configuration; the rows, and the answers behind each."""
    columns = product(axes)
    rows, answers = [], []
    for number in range(len(next(iter(columns.values())))):
        one = jax.tree.map(lambda leaf: np.asarray(leaf)[number], result)  # noqa: B023
        found = best_answers(one, *truth)
        values = {name: float(f"{column[number]:.7g}") for name, column in columns.items()}
        rows.append({"configuration": number, **values, **_figures(found, one, false_rate)})
        answers.append(found)
    with atomic_write(out / "sweep.csv") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    if importlib.util.find_spec("pyarrow") is not None:
        _write_parquet(out / "sweep.parquet", rows)
    return rows, answers


def _figures(answers: Answers, result: MatchResult, false_rate: float) -> dict[str, Any]:
    """Counts of the answers that may be acted on; shares of the mapped queries."""
    confident, queries = np.asarray(result.confident), len(answers.mapped)
    correct, false = (int(np.sum(mask & confident)) for mask in (answers.right, answers.wrong))
    mapped = int(answers.mapped.sum())
    hits = answers.accepted(false_rate, free=1)
    return {
        "queries": queries,
        "mapped": mapped,
        "correct": correct,
        "false": false,
        "none": queries - correct - false,
        "top1": round(float(answers.right.sum() / mapped), 6) if mapped else float("nan"),
        "hits": round(hits, 6),
    }


def write_curves(out: Path, answers: Sequence[Answers]) -> list[QualityCurve]:
    """`curves.csv`, a row for each threshold on e_m of each configuration; the curves."""
    curves = [QualityCurve.of(each) for each in answers]
    with atomic_write(out / "curves.csv") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("configuration", "quality", "recall", "precision", "false_rate"))
        for number, curve in enumerate(curves):
            columns = (curve.quality, curve.recall, curve.precision, curve.false_rate)
            for row in zip(*columns, strict=True):
                table.writerow((number, *(f"{value:.7g}" for value in row)))
    return curves


def write_figures(
    out: Path,
    axes: Mapping[str, np.ndarray],
    rows: Sequence[dict[str, Any]],
    curves: Sequence[QualityCurve],
) -> list[str]:
    """The pictures; the names of all results in the folder."""
    shape = [len(values) for values in axes.values()]

    def share(name: str, of: str) -> np.ndarray:
        """Counts as a share of others, and shares as they are."""
        values = [row[name] / max(row[of], 1) if of else row[name] for row in rows]
        return np.array(values, float).reshape(shape)

    shares = {"hits": share("hits", ""), "top1": share("top1", "")}
    if len(shape) == 1:
        shares["correct and confident, of the mapped"] = share("correct", "mapped")
        shares["false and confident, of all queries"] = share("false", "queries")
    _save(draw_sweep(axes, shares, "hits"), out / "sweep.png")
    labels = [", ".join(f"{name} {row[name]:g}" for name in axes) for row in rows]
    _save(draw_quality_curves(curves, labels), out / "curves.png")
    names = ("sweep.csv", "sweep.parquet", "curves.csv", "sweep.png", "curves.png", "times.csv")
    return [name for name in names if name == "times.csv" or (out / name).exists()]


def _write_parquet(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    arrow, parquet = importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    with atomic_write(path, "wb") as file:
        parquet.write_table(arrow.Table.from_pylist(list(rows)), file)


def _save(figure: Figure, path: Path) -> None:
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=_DPI)
