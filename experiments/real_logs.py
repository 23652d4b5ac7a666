"""Global matching on the real logs' splits: how good it is, and where right answers are lost.

    python -m experiments.real_logs --out DIR [--quick] [SPLIT ...]

For each split (reference and query logs with true poses; see `data.py` for where), all queries are
matched globally with all references, with the 5 and with the 1 of the highest preselection value
(paper 2.E), by one set of defaults. Poses in the logs serve only to score. Writes into DIR:

- `real_logs.csv`: shares of the queries that were taken where a reference is (mapped). top1: the
  best hypothesis is right (within 0.5 m and 10°); oracle: any is; hits: right best ones accepted
  by the most generous threshold on e_m with at most one in 500 wrong, or a single one; at_0.2%
  and at_1%: the same with at most that share of the accepted wrong. Median errors of the right
  ones; expected calibration error of `probability` over all queries, wherever they were taken.
  Of all queries, as the paper counts (2.E): correct and false answers that may be acted on
  (`confident`), and none. The row `six` has means over the splits of `SIX`, sums of what is
  counted, but at_0.2% and at_1% with one threshold for all of them.
- `times.csv`: milliseconds of a query in a batch, and with one scan at a time the mean and the
  longest of a hundred (not with --quick), compilation apart; in the row `six`
  their means, and the longest of all.
- `misses.csv`: of the mapped queries whose best hypothesis of all references is not right, how
  many were lost at which stage; see `misses.py`. The last column counts right ones that the
  threshold of hits does not accept.
- `reliability.png`: how often each log's hypotheses are right, over the probability they claim.
- `map-SPLIT.png`: the paper's Fig. 3, the answers that may be acted on (`confident`).
- `configuration.json`: the defaults that made them.
"""

import argparse
import dataclasses
import sys
import time
from collections.abc import Set
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.metrics import (
    Answers,
    best_answers,
    is_right,
    pooled,
    reliability,
    score_matches,
    world_poses,
)
from aprjax.plane import transform
from aprjax.plot.map import draw_map
from aprjax.plot.reliability import draw_reliability
from aprjax.plot.style import figure_of
from benchmarks.timing import timed
from experiments.data import Split, read_split, split_names
from experiments.misses import Loss, losses
from experiments.outputs import print_table, write_configuration, write_figure, write_table

CHOICES: dict[str, int | None] = {"1": 1, "5": 5, "all": None}  # references aligned
SIX = (
    "freiburg-079.revisit",
    "fhw.revisit",
    "intel.interleaved",
    "intel.revisit",
    "aces.interleaved",
    "belgioioso.interleaved",
)
QUICK = "fhw.revisit"
FALSE = {"at_0.2%": 0.002, "at_1%": 0.01}
COUNTED = ("correct", "false", "none")
NAMES, TIMES = {"split", "references"}, {"ms", "single_ms", "longest_ms"}
SINGLE = 100  # queries that are matched by themselves
COLUMNS = 4  # of the reliability diagrams, at most


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What came of a split's queries with one choice of references."""

    split: Split
    references: aprjax.ReferenceSet
    result: aprjax.MatchResult
    seconds: float
    """A query, in a batch."""
    single: np.ndarray | None
    """Seconds of queries one at a time."""

    @property
    def poses(self) -> np.ndarray:
        """Where the best hypotheses say that the queries were taken, `(queries, 3)`."""
        return world_poses(self.result, self.references.ids, self.split.T_world_ref)[:, 0]

    @property
    def right(self) -> np.ndarray:
        """Whether the best hypotheses are right, wherever the queries were taken."""
        valid = np.asarray(self.result.valid)[:, 0]
        return valid & is_right(self.poses, self.split.T_world_query)

    @property
    def probability(self) -> np.ndarray:
        """What the best hypotheses claim."""
        return np.asarray(self.result.probability)[:, 0]

    @property
    def answers(self) -> Answers:
        """The best hypotheses, to be accepted by a threshold."""
        split = self.split
        return best_answers(
            self.result, self.references.ids, split.T_world_ref, split.T_world_query, split.mapped
        )


def matched(split: Split, top_k: int | None, single: bool) -> Outcome:
    """All queries of a split, timed after a first call that compiles; some by themselves too."""
    print(f"{split.name}: references aligned: {top_k or 'all'}", file=sys.stderr, flush=True)
    references = aprjax.ReferenceSet.build(split.references)
    config = dataclasses.replace(aprjax.MatchConfig(), top_k=top_k)
    jax.block_until_ready(aprjax.match_batch(split.queries, references, config))
    began = time.perf_counter()
    result = jax.block_until_ready(aprjax.match_batch(split.queries, references, config))
    seconds = (time.perf_counter() - began) / len(split.T_world_query)
    alone = None
    if single:
        each = [jax.tree.map(lambda a: np.asarray(a)[k], split.queries) for k in range(SINGLE)]  # noqa: B023
        alone = timed(lambda k: aprjax.match(each[k], references, config), SINGLE)
    return Outcome(split, references, result, seconds, alone)


def table(choice: str, outcomes: list[Outcome]) -> list[dict]:
    """A row for each split, and one for the six if all of them are there."""
    rows = [scored(choice, outcome) for outcome in outcomes]
    six = [k for k, outcome in enumerate(outcomes) if outcome.split.name in SIX]
    if len(six) < len(SIX):
        return rows
    together = pooled([outcomes[k].answers for k in six])
    totals = {
        "split": "six",
        "references": choice,
        "mapped": int(together.mapped.sum()),
        **{name: round(together.accepted(false), 4) for name, false in FALSE.items()},
        **{name: sum(rows[k][name] for k in six) for name in COUNTED},
        "longest_ms": max(rows[k]["longest_ms"] for k in six),
    }
    means = {
        name: round(float(np.mean([rows[k][name] for k in six])), 4)
        for name in rows[0].keys() - totals.keys()
    }
    return [*rows, {name: {**totals, **means}[name] for name in rows[0]}]


def scored(choice: str, outcome: Outcome) -> dict:
    """A row of the table."""
    split, answers, alone = outcome.split, outcome.answers, outcome.single
    truth = (split.T_world_ref, split.T_world_query)
    scores = score_matches(outcome.result, outcome.references.ids, *truth, split.mapped)
    return {
        "split": split.name,
        "references": choice,
        "mapped": int(split.mapped.sum()),
        "top1": round(scores.top1, 4),
        "oracle": round(scores.oracle, 4),
        "hits": round(scores.hits, 4),
        **{name: round(answers.accepted(false), 4) for name, false in FALSE.items()},
        "error_m": round(scores.error_m, 4),
        "error_deg": round(scores.error_deg, 4),
        "calibration": round(reliability(outcome.probability, outcome.right).error, 4),
        **counted(outcome),
        "ms": round(1e3 * outcome.seconds, 2),
        "single_ms": float("nan") if alone is None else round(1e3 * float(alone.mean()), 2),
        "longest_ms": float("nan") if alone is None else round(1e3 * float(alone.max()), 2),
    }


def counted(outcome: Outcome) -> dict[str, int]:
    """Of all queries: answers that may be acted on, by whether they are right, and no answer."""
    confident = np.asarray(outcome.result.confident)
    numbers = (confident & outcome.right, confident & ~outcome.right, ~confident)
    return dict(zip(COUNTED, (int(each.sum()) for each in numbers), strict=True))


def missed(outcome: Outcome) -> dict:
    """A row of the breakdown."""
    split, answers = outcome.split, outcome.answers
    miss = np.flatnonzero(split.mapped & ~answers.right)
    counts = np.zeros(len(Loss), int)
    if len(miss):
        queries = jax.tree.map(lambda array: array[miss], split.queries)
        lost = losses(queries, outcome.references, split.T_world_ref, split.T_world_query[miss])
        counts = np.bincount(lost, minlength=len(Loss))
    mapped = int(split.mapped.sum())
    hits = round(answers.accepted(0.002, free=1) * mapped) if mapped else 0
    return {
        "split": split.name,
        "mapped": mapped,
        "missed": len(miss),
        **{loss.name.lower(): int(count) for loss, count in zip(Loss, counts, strict=True)},
        "right_not_accepted": int(answers.right.sum()) - hits,
    }


def reliability_figure(outcomes: list[Outcome]) -> Figure:
    """A diagram for each split."""
    columns = min(len(outcomes), COLUMNS)
    rows = -(-len(outcomes) // columns)
    figure = Figure(figsize=(3.25 * columns, 3.4 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for ax in axes.flat[len(outcomes) :]:
        ax.remove()
    for outcome, ax in zip(outcomes, axes.flat, strict=False):
        draw_reliability(outcome.probability, outcome.right, outcome.split.name, ax=ax)
    return figure


def map_figure(outcome: Outcome) -> Figure:
    """The answers that may be acted on, over what the reference scans saw."""
    confident = np.asarray(outcome.result.confident)
    drawn = draw_map(
        seen_points(outcome.split.references, outcome.split.T_world_ref),
        outcome.split.T_world_ref,
        outcome.poses,
        confident & outcome.right,
        confident & ~outcome.right,
    )
    return figure_of(drawn)


def seen_points(scans: aprjax.Scan, T_world_laser: np.ndarray) -> np.ndarray:
    """The end points `(points, 2)` of stacked scans from their poses, in the world's frame."""
    points = np.asarray(scans.points, float)
    return transform(T_world_laser[:, None], points)[np.asarray(scans.hit)]


def without(names: Set[str], row: dict) -> dict:
    """The other columns of a row."""
    return {name: value for name, value in row.items() if name not in names}


def main() -> int:
    """Match, print, write; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("splits", nargs="*", help="names of splits (default: all)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--quick", action="store_true", help="one split, every fourth query, one or all references"
    )
    arguments = parser.parse_args()
    names = arguments.splits or ([QUICK] if arguments.quick else split_names())
    every = 4 if arguments.quick else 1
    splits = [read_split(name, every) for name in names]
    arguments.out.mkdir(parents=True, exist_ok=True)

    rows: list[dict] = []
    everything: list[Outcome] = []
    for choice in ("1", "all") if arguments.quick else CHOICES:
        # The last choice is all.
        everything = [matched(split, CHOICES[choice], not arguments.quick) for split in splits]
        of_choice = table(choice, everything)
        print_table(of_choice)
        rows += of_choice
    breakdown = [missed(outcome) for outcome in everything]
    print_table(breakdown)

    write_table([without(TIMES, row) for row in rows], arguments.out / "real_logs.csv")
    write_table(
        [without(row.keys() - NAMES - TIMES, row) for row in rows], arguments.out / "times.csv"
    )
    write_table(breakdown, arguments.out / "misses.csv")
    write_figure(reliability_figure(everything), arguments.out / "reliability.png")
    for outcome in everything:
        write_figure(map_figure(outcome), arguments.out / f"map-{outcome.split.name}.png")
    write_configuration(arguments.out, splits=names, every=every)
    return 0


if __name__ == "__main__":
    sys.exit(main())
