"""What each part of the method is worth: one left out at a time, on real logs.

    python -m experiments.ablations --out DIR [--quick] [--stride N] [SPLIT ...]

Each split (see `data.py` for where) is matched with all references by the defaults, and with one
thing changed:

- `no jump edges`, `no angles`, `no virtual edges`: anchors of that kind are left out;
- `no refinement`: alternatives are looked at and evaluated as edges put them (only the last solve
  stays);
- `one direction`: e_m counts the query's beams on the synthetic scan from the reference alone;
  `both directions`: those of both scans, always. The paper's rule, which the defaults follow,
  takes the scan with the better overview;
- `no rivals`: a rival costs no quality, and leaves an answer confident;
- `half of the references`, `a quarter`: every second, every fourth one;
- `no cascade`: the paper's way, with matching angle histograms and correspondence matrices, all
  alternatives of all references evaluated (not with --quick);
- `no cascade, no angle histogram`: the same with matrices of all pairs of edges of one length,
  whatever the rotation between them (likewise).

Prints and writes `ablations.csv`: for each split and variant, and for their means, top1 and hits
(shares of the mapped queries, as in `real_logs.py`: hits with at most 0.2 % of the accepted
wrong, or one), right and wrong answers that may be acted on (`confident`), and how far hits are
from the defaults'. Queries stay mapped when references are left out. `ablations.png` shows the
hits. `configuration.json` is what made them.
"""

import argparse
import sys
from dataclasses import dataclass, field
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from matplotlib.figure import Figure

import aprjax
from aprjax.evaluation.congruence import both_ways, quality, sees
from aprjax.features import Features
from aprjax.matcher import Evaluated, answer, cascade, evaluate, exhaustive, rank
from aprjax.metrics import best_answers
from aprjax.references import ReferenceIndex
from aprjax.result import Counts
from aprjax.se2 import Pose, inverse
from aprjax.sweeping.axes import configured
from experiments.data import FOUR, Split, read_split
from experiments.outputs import (
    BLUE,
    DARK,
    LIGHT,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

FALSE = 0.002
BETTER_OVERVIEW, ONE, BOTH = range(3)  # whose beams count


@dataclass(frozen=True)
class Variant:
    """What differs from the defaults."""

    features: dict[str, float] = field(default_factory=dict)
    match: dict[str, float] = field(default_factory=dict)
    direction: int = BETTER_OVERVIEW
    nth: int = 1
    """Every which reference takes part."""
    cascade: bool = True


_CLOSE = 1e-6  # metres: a gate that nothing passes
VARIANTS = {
    "defaults": Variant(),
    "no jump edges": Variant(features={"extraction.jump_edge.jump": 1e3}),
    "no angles": Variant(features={"extraction.angle.min_angle": 4.0}),
    "no virtual edges": Variant(features={"extraction.virtual_edge.min_length": 1e3}),
    "no refinement": Variant(
        match={
            f"{stage}.{gate}": _CLOSE
            for stage in ("refine", "shortlist.settle")
            for gate in ("gate", "final_gate")
        }
    ),
    "one direction": Variant(direction=ONE),
    "both directions": Variant(direction=BOTH),
    "no rivals": Variant(match={"distinctiveness.weight": 0.0, "distinctiveness.equal": 1e3}),
    "half of the references": Variant(nth=2),
    "a quarter": Variant(nth=4),
    "no cascade": Variant(cascade=False),
    "no cascade, no angle histogram": Variant(
        match={"alignment.correspondence.angle": np.pi}, cascade=False
    ),
}


@jax.jit
def _answers(
    queries: Features,
    allowed: Bool[Array, " rows"],
    references: ReferenceIndex,
    config: aprjax.MatchConfig,
    direction: Int[Array, ""],
) -> aprjax.MatchResult:
    """The matcher's stages, with e_m counted in a direction of choice."""
    candidates = cascade if config.cascade else exhaustive
    none = jnp.int32(0)

    def one(query: Features) -> aprjax.MatchResult:
        _, listed = candidates(query, allowed, references, config)
        evaluated = evaluate(query, listed, references.features, config)
        e_m = _qualities(query, evaluated, references.features, config, direction)
        e_m = jnp.where(listed.alternatives.valid, e_m, 0.0)
        evaluated = eqx.tree_at(lambda e: e.e_m, evaluated, e_m)
        ranked = rank(evaluated, references, config)
        counts = Counts(none, none, none, none, none)
        q_m = jnp.zeros(allowed.shape[0])
        return answer(query, q_m, evaluated, ranked, counts, references, config)

    return jax.lax.map(one, queries)


def _qualities(
    query: Features,
    evaluated: Evaluated,
    references: Features,
    config: aprjax.MatchConfig,
    direction: Int[Array, ""],
) -> Float[Array, " kept"]:
    """e_m of evaluated alternatives, by whose beams the direction says."""

    def one(T_ref_query: Pose, row: Int[Array, ""], anchors: Int[Array, ""]) -> Float[Array, ""]:
        view = jax.tree.map(lambda array: array[row], references.view)
        ahead, back = both_ways(view, query.view, T_ref_query, config.congruence)
        by_reference = sees(view, T_ref_query[:2])
        by_query = sees(query.view, inverse(T_ref_query)[:2])
        return quality(
            ahead,
            back,
            (by_reference & (direction == BETTER_OVERVIEW)) | (direction == ONE),
            by_query & (direction == BETTER_OVERVIEW),
            anchors,
            config.congruence.quality,
        )

    return jax.vmap(one)(evaluated.T_ref_query, evaluated.row, evaluated.anchors)


def measured(split: Split, variant: Variant) -> dict:
    """The figures of one variant on one split."""
    features = configured(aprjax.FeatureConfig(), variant.features)
    config = configured(aprjax.MatchConfig(cascade=variant.cascade, hypotheses=1), variant.match)
    references = aprjax.ReferenceSet.build(split.references, features)
    queries = aprjax.ReferenceSet.build(split.queries, features).index.features
    allowed = np.asarray(references.index.valid) & (
        np.asarray(references.index.ids) % variant.nth == 0
    )
    result = _answers(queries, allowed, references.index, config, np.int32(variant.direction))
    count = len(split.mapped)
    result = jax.tree.map(lambda leaf: np.asarray(leaf)[:count], result)
    answers = best_answers(
        result, references.ids, split.T_world_ref, split.T_world_query, split.mapped
    )
    mapped = int(split.mapped.sum())
    return {
        "top1": round(float(answers.right.sum() / mapped), 4),
        "hits": round(answers.accepted(FALSE, free=1), 4),
        "confident_right": round(float(np.sum(answers.right & result.confident) / mapped), 4),
        "confident_wrong": int(np.sum(answers.wrong & result.confident)),
    }


def table(found: dict[str, dict[str, dict]]) -> list[dict]:
    """Rows of variants by split, and their means; `found` by variant, then by split."""
    rows = []
    for variant, by_split in found.items():
        figures = list(by_split.values())
        mean = {name: round(float(np.mean([f[name] for f in figures])), 4) for name in figures[0]}
        for split, figure in {**by_split, "mean": mean}.items():
            base = figure if variant == "defaults" else next(r for r in rows if r["split"] == split)
            change = figure["hits"] - base["hits"]
            rows.append({"variant": variant, "split": split, **figure, "change": round(change, 4)})
    return rows


def draw(rows: list[dict]) -> Figure:
    """Hits of each variant, a bar for the mean and a dot for each split."""
    variants = list(dict.fromkeys(row["variant"] for row in rows))
    figure = Figure(figsize=(7.5, 0.38 * len(variants) + 1.4), layout="constrained")
    ax = figure.add_subplot()
    for place, variant in enumerate(variants):
        mine = {row["split"]: row["hits"] for row in rows if row["variant"] == variant}
        mean = mine.pop("mean")
        ax.barh(place, mean, color=BLUE if place == 0 else LIGHT, height=0.7)
        ax.scatter(list(mine.values()), [place] * len(mine), s=14, color=DARK, zorder=3)
        colour = "white" if place == 0 else "black"
        ax.text(0.01, place, f"{mean:.3f}", va="center", fontsize=8, color=colour)
    ax.set_yticks(range(len(variants)), variants)
    ax.invert_yaxis()
    ax.set(xlim=(0, 1.02), xlabel="hits with at most 0.2 % wrong, or one: mean, and single logs")
    return figure


def main() -> int:
    """Match, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("splits", nargs="*", help="names of splits (default: four)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--stride", type=int, default=2, help="every which query (default: 2)")
    parser.add_argument("--quick", action="store_true", help="one split, every eighth query")
    arguments = parser.parse_args()
    names = arguments.splits or (FOUR[1:2] if arguments.quick else FOUR)
    stride = 8 if arguments.quick else arguments.stride
    variants = {
        name: variant
        for name, variant in VARIANTS.items()
        if variant.cascade or not arguments.quick
    }
    splits = [read_split(name, stride) for name in names]
    arguments.out.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, dict]] = {}
    for name, variant in variants.items():
        print(name, file=sys.stderr, flush=True)
        found[name] = {split.name: measured(split, variant) for split in splits}
        write_table(table(found), arguments.out / "ablations.csv")
    rows = table(found)
    print_table(rows)
    write_figure(draw(rows), arguments.out / "ablations.png")
    write_configuration(arguments.out, splits=names, every=stride, false_rate=FALSE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
