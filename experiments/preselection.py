"""Which references come first: by q_m of the paper, plain c_m, votes for poses, or signatures.

    python -m experiments.preselection --out DIR [--quick] [SPLIT ...]

The paper aligns the references of the highest q_m = c_m² / (k_act k_m), c_m being the pairs of
edges of corresponding length, and says that this keeps big graphs from becoming more attractive
only due to accidental correspondences (2.B). Here each mapped query of a split (see `data.py` for
where) ranks a set of references by c_m, by q_m, by the best rated pose that edges vote for in each
(`aprjax.alignment.voting`), and by how like the places' signatures are
(`aprjax.evaluation.signature`). A reference is right that was taken within 2 m and 40° of the
query. The set is all references, or some of them drawn at random; queries without a right
reference in it do not count. Writes into DIR:

- `preselection.csv`: for each split, size of the set and measure the share of the queries with a
  right reference among the first 1, 5, 10 and 20, and how many edges the first one has, over the
  mean of the set: `bigness`, 1 where the size of a graph plays no part;
- `preselection.png`: the mean over the splits, over the number of references that are aligned, of
  all references; and for the first five over the size of the set;
- `configuration.json`.
"""

import argparse
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from matplotlib.figure import Figure

import aprjax
from aprjax.alignment.voting import vote
from aprjax.evaluation.signature import likeness
from aprjax.features import Features
from aprjax.metrics import is_near
from aprjax.references import ReferenceIndex
from aprjax.relations.graph import AnchorGraph
from aprjax.relations.histograms import count_correspondences, preselection_quality
from experiments.data import Split, read_split
from experiments.outputs import (
    BLUE,
    RED,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

SPLITS = (
    "freiburg-079.revisit",
    "fhw.revisit",
    "intel.interleaved",
    "aces.interleaved",
    "belgioioso.interleaved",
)
SIZES = (10, 20, 40, 80)
FIRST = (1, 5, 10, 20)
MEASURES = {"c_m": RED, "q_m": BLUE, "votes": "#2a8a3e", "signature": "#8a5a00"}
SEED = 0


@jax.jit
def _of_scans(queries: Features, references: ReferenceIndex) -> dict[str, Array]:
    """c_m, q_m and the likeness of signatures, `(queries, rows)` each."""
    relation, known = references.config.relation, references.features.histogram
    signatures = references.features.signature
    return {
        "c_m": count_correspondences(queries.histogram, known, relation),
        "q_m": preselection_quality(queries.histogram, known, relation),
        "signature": jax.vmap(likeness, (None, 0))(signatures, queries.signature),
    }


@jax.jit
def _of_votes(
    queries: Features,
    allowed: Bool[Array, " rows"],
    references: ReferenceIndex,
    config: aprjax.MatchConfig,
) -> Float[Array, "queries rows"]:
    """The best rating of a pose in each reference; zero where none was kept."""
    k_m = references.features.histogram.edges

    def one(graph: AnchorGraph) -> Array:
        votes = vote(references.edges, k_m, allowed, graph, config.voting)
        rating = jnp.where(votes.valid, votes.rating, 0.0)
        return jnp.zeros(k_m.shape[0]).at[votes.row].max(rating)

    return jax.lax.map(one, queries.graph)


def rank_of_right(scores: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The place `(queries,)` of the first right reference, from 0; `scores` `(queries, refs)`.

    Among equals the right ones come last: a measure that tells nothing gets nothing for it.
    """
    best = np.max(np.where(right, scores, -np.inf), axis=1)
    return np.sum((scores >= best[:, None]) & ~right, axis=1)


def measured(split: Split, sizes: tuple[int, ...]) -> list[dict]:
    """The rows of a split."""
    print(f"{split.name}: {int(split.mapped.sum())} mapped queries", file=sys.stderr, flush=True)
    references = aprjax.ReferenceSet.build(split.references)
    scans = jax.tree.map(lambda array: np.asarray(array)[split.mapped], split.queries)
    index, count = references.index, len(references)
    queries = aprjax.ReferenceSet.build(scans, references.config).index.features
    right = is_near(split.T_world_ref[None], split.T_world_query[split.mapped][:, None])
    of_scans = jax.device_get(_of_scans(queries, index))
    k_m = np.asarray(index.features.histogram.edges)[:count]

    rng, rows = np.random.default_rng(SEED), []
    for size in (*(size for size in sizes if size < count), count):
        chosen = np.sort(rng.choice(count, size, replace=False))
        allowed = np.zeros(index.ids.shape[0], bool)
        allowed[chosen] = True
        votes = _of_votes(queries, allowed, index, aprjax.MatchConfig())
        able = np.flatnonzero(right[:, chosen].any(axis=1))
        if not len(able):
            continue
        for measure in MEASURES:
            scores = np.asarray(votes) if measure == "votes" else of_scans[measure]
            scores = scores[: len(right)][np.ix_(able, chosen)]
            place = rank_of_right(scores, right[np.ix_(able, chosen)])
            first = k_m[chosen][np.argmax(scores, axis=1)]
            rows.append(
                {
                    "split": split.name,
                    "references": "all" if size == count else size,
                    "measure": measure,
                    "queries": len(able),
                    **{f"first_{k}": round(float(np.mean(place < k)), 4) for k in FIRST},
                    "bigness": round(float(first.mean() / k_m[chosen].mean()), 3),
                }
            )
    return rows


def means(rows: list[dict]) -> list[dict]:
    """A row for each size and measure: means over the splits that have it."""
    found = []
    sizes = {row["references"] for row in rows}
    for size in sorted(sizes, key=lambda size: (size == "all", size)):
        for measure in MEASURES:
            here = [r for r in rows if (r["references"], r["measure"]) == (size, measure)]
            columns = [f"first_{k}" for k in FIRST] + ["bigness"]
            found.append(
                {
                    "split": "mean",
                    "references": size,
                    "measure": measure,
                    "queries": sum(row["queries"] for row in here),
                    **{c: round(float(np.mean([row[c] for row in here])), 4) for c in columns},
                }
            )
    return found


def draw(rows: list[dict]) -> Figure:
    """The means: over the number of references aligned, and over the size of the set."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for measure, colour in MEASURES.items():
        mine = [row for row in rows if row["measure"] == measure]
        style = {"color": colour, "marker": "o", "markersize": 4, "label": measure}
        every = next(row for row in mine if row["references"] == "all")
        left.plot(FIRST, [every[f"first_{k}"] for k in FIRST], **style)
        some = [row for row in mine if row["references"] != "all"]
        right.plot([r["references"] for r in some], [r["first_5"] for r in some], **style)
    left.set(xlabel="references aligned, of all", ylabel="share with a right one among them")
    right.set(xlabel="references in the set, of which five are aligned")
    for ax in (left, right):
        ax.set_ylim(-0.03, 1.03)
        ax.grid(color="#dddddd", linewidth=0.5)
    left.set_xticks(FIRST)
    left.legend(loc="lower right", frameon=False)
    return figure


def main() -> int:
    """Measure, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("splits", nargs="*", help="names of splits (default: five)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="two splits, every eighth query")
    arguments = parser.parse_args()
    names = arguments.splits or (SPLITS[:2] if arguments.quick else SPLITS)
    every, sizes = (8, SIZES[1:2]) if arguments.quick else (1, SIZES)
    splits = [read_split(name, every) for name in names]
    arguments.out.mkdir(parents=True, exist_ok=True)
    rows = [row for split in splits for row in measured(split, sizes)]
    together = means(rows)
    print_table([*rows, *together])
    write_table([*rows, *together], arguments.out / "preselection.csv")
    write_figure(draw(together), arguments.out / "preselection.png")
    write_configuration(arguments.out, splits=names, every=every, sizes=sizes, seed=SEED)
    return 0


if __name__ == "__main__":
    sys.exit(main())
