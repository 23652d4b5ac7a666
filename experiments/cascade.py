"""What the cascade loses: every alternative fully evaluated, or those that a shortlist keeps.

    python -m experiments.cascade --out DIR [--quick] [--stride N] [SPLIT ...]

For each split (see `data.py` for where) every fourth query is matched with all references, once
with `MatchConfig(cascade=True)` and once with `cascade=False`. Prints, and writes into DIR,
`cascade.csv`: top1 and hits of both (shares of the mapped queries, as in `real_logs.py`); of how
many queries the best answers differ, in the reference, or by more than 0.1 m or 2°, and of these
how many are right only with the cascade and only without; and how often the shortlist lost the best
answer (`lost`): the cascade has another one of lower e_m, or none. `cascade.png` shows the hits;
`configuration.json` is what made them.
"""

import argparse
import dataclasses
import sys
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.metrics import deviations, is_right, score_matches, world_poses
from experiments.data import Split, read_split, split_names
from experiments.outputs import (
    grouped_bars,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

QUICK = "aces.interleaved"
SAME_DISTANCE, SAME_ANGLE = 0.1, np.radians(2)  # metres and radians between poses that are one


def differing(a: aprjax.MatchResult, b: aprjax.MatchResult) -> np.ndarray:
    """Of which queries `(queries,)` the best answers of two batched results are not the same."""
    gap, turn = deviations(_best(a.T_ref_query), _best(b.T_ref_query))
    valid_a, valid_b = _best(a.valid), _best(b.valid)
    moved = (gap > SAME_DISTANCE) | (turn > SAME_ANGLE)
    other = (_best(a.reference) != _best(b.reference)) | moved
    return (valid_a != valid_b) | (valid_a & other)


def compared(split: Split) -> dict:
    """The row of one split."""
    print(f"{split.name}: {len(split.mapped)} queries", file=sys.stderr, flush=True)
    references = aprjax.ReferenceSet.build(split.references)
    with_, without = (
        aprjax.match_batch(
            split.queries, references, dataclasses.replace(aprjax.MatchConfig(), cascade=cascade)
        )
        for cascade in (True, False)
    )
    return row(split, references.ids, with_, without)


def row(
    split: Split, ids: np.ndarray, with_: aprjax.MatchResult, without: aprjax.MatchResult
) -> dict:
    """The figures of a split's results with the cascade and without."""
    scores = [
        score_matches(result, ids, split.T_world_ref, split.T_world_query, split.mapped)
        for result in (with_, without)
    ]
    right = [
        _best(result.valid)
        & is_right(world_poses(result, ids, split.T_world_ref)[:, 0], split.T_world_query)
        for result in (with_, without)
    ]
    differ = differing(with_, without)
    lower = _best(with_.quality) < _best(without.quality)
    return {
        "split": split.name,
        "queries": len(split.mapped),
        "mapped": int(split.mapped.sum()),
        "top1": round(scores[0].top1, 4),
        "top1_all": round(scores[1].top1, 4),
        "hits": round(scores[0].hits, 4),
        "hits_all": round(scores[1].hits, 4),
        "differ": int(differ.sum()),
        "right_only_with": int(np.sum(right[0] & ~right[1])),
        "right_only_without": int(np.sum(right[1] & ~right[0])),
        "lost": int(np.sum(differ & lower)),
    }


def _best(array: jax.Array) -> np.ndarray:
    """Of each query's best hypothesis."""
    return np.asarray(array)[:, 0]


def draw(rows: list[dict]) -> Figure:
    """Hits with and without the cascade by split."""
    figure = Figure(figsize=(7.5, 0.5 * len(rows) + 1.3), layout="constrained")
    ax = figure.add_subplot()
    hits = {
        "with the cascade": [row["hits"] for row in rows],
        "all alternatives evaluated": [row["hits_all"] for row in rows],
    }
    grouped_bars(ax, [row["split"] for row in rows], hits)
    ax.set(xlim=(0, 1.1), xlabel="hits with at most 0.2 % of the accepted wrong, or one")
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def main() -> int:
    """Match, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("splits", nargs="*", help="names of splits (default: all)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--stride", type=int, default=4, help="every which query (default: 4)")
    parser.add_argument("--quick", action="store_true", help="one split, every sixteenth query")
    arguments = parser.parse_args()
    stride = 16 if arguments.quick else arguments.stride
    names = arguments.splits or ([QUICK] if arguments.quick else split_names())
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = [compared(read_split(name, stride)) for name in names]
    print_table(rows)
    write_table(rows, arguments.out / "cascade.csv")
    write_figure(draw(rows), arguments.out / "cascade.png")
    write_configuration(arguments.out, splits=names, every=stride)
    return 0


if __name__ == "__main__":
    sys.exit(main())
