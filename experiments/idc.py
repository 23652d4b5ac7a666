"""Iterative dual correspondence on real logs: how far from the truth it ends.

`python -m experiments.idc --out DIR [--quick]`

Pairs of a reference and a query that overlap by half: of the hits of either scan, at least half
lie within 0.1 m of the other's surface at the true pose. Up to 60 pairs of each split, drawn by a
fixed seed; starts 0.3 m off in a random direction and 10° to a random side. Prints for
each split and for all the median error, the share within 0.2 m and 2°, the share that
`converged`, and that of pairs of different places which did, the queries given to each other's
references. Beside them what point-to-line refinement (`refine`) alone makes of the same starts.
Writes `idc.csv`, `idc.png`, the distributions of both errors, and `configuration.json`. The logs'
poses serve only to choose pairs and to score; see `data.py` for where the logs lie.
"""

import argparse
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.configuration import to_dict
from aprjax.evaluation.view import View
from aprjax.metrics import deviations
from aprjax.plane import relative, transform
from aprjax.refine import RefineConfig, refine
from aprjax.se2 import compose
from aprjax.tracking.idc import IdcConfig, idc
from experiments.data import Split, read_split, split_names
from experiments.outputs import (
    BLUE,
    DARK,
    LIGHT,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

PAIRS = 60
DISTANCE, ANGLE = 0.3, np.radians(10.0)  # of the starts from the truth
NEAR, TURNED = 0.2, np.radians(2.0)  # of a good end from the truth
OVERLAP, SURFACE = 0.5, 0.1
FARTHEST = 6.0  # metres between reference and query


def main() -> int:
    """Choose pairs, match, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="ten pairs of each split")
    arguments = parser.parse_args()
    refine_batch = jax.jit(jax.vmap(refine, (0, 0, 0, None)))
    rows, ends = [], []
    count = 10 if arguments.quick else PAIRS
    names = split_names()
    for name in names:
        references, queries, truth = pairs_of(read_split(name), count)
        start = starts(truth)
        idc(references, queries, start, IdcConfig())
        began = time.perf_counter()
        found = jax.block_until_ready(idc(references, queries, start, IdcConfig()))
        ms = 1e3 * (time.perf_counter() - began) / len(truth)
        strange = jax.tree.map(lambda array: np.roll(array, array.shape[0] // 2, axis=0), queries)
        wrong = idc(references, strange, start, IdcConfig()).converged
        alone = refine_batch(references, queries, start, RefineConfig()).T_ref_query
        gap, turn = deviations(np.asarray(found.T_ref_query, float), truth)
        gap_alone, turn_alone = deviations(np.asarray(alone, float), truth)
        ends.append(np.stack([gap, turn, found.converged, wrong, gap_alone, turn_alone]))
        rows.append({"split": name, **figures(*ends[-1]), "ms": f"{ms:.1f}"})
    every = np.concatenate(ends, axis=1)
    rows.append({"split": "all", **figures(*every), "ms": ""})

    print_table(rows)
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_table(rows, arguments.out / "idc.csv")
    write_figure(draw(*every), arguments.out / "idc.png")
    write_configuration(
        arguments.out, splits=names, pairs=count, overlap=OVERLAP,
        start_m=DISTANCE, start_rad=ANGLE, idc=to_dict(IdcConfig()),
    )  # fmt: skip
    return 0


def figures(gap, turn, converged, wrong, gap_alone, turn_alone) -> dict[str, object]:
    """Medians and shares of some pairs' ends."""
    good = (gap < NEAR) & (turn < TURNED)
    return {
        "pairs": len(gap),
        "median_m": f"{np.median(gap):.3f}",
        "median_deg": f"{np.degrees(np.median(turn)):.2f}",
        "within": f"{good.mean():.3f}",
        "converged": f"{converged.mean():.3f}",
        "wrong_converged": f"{wrong.mean():.3f}",
        "refine_m": f"{np.median(gap_alone):.3f}",
        "refine_within": f"{np.mean((gap_alone < NEAR) & (turn_alone < TURNED)):.3f}",
    }


def draw(gap, turn, converged, wrong, gap_alone, turn_alone) -> Figure:
    """Distributions of some pairs' ends beside the starts."""
    figure = Figure(figsize=(9.5, 3.8), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    share = np.arange(1, len(gap) + 1) / len(gap)
    for ax, start, ends, unit in (
        (panels[0], DISTANCE, (gap, gap_alone), "distance from the truth / m"),
        (panels[1], np.degrees(ANGLE), np.degrees((turn, turn_alone)), "angle from the truth / °"),
    ):
        ax.axvline(start, color=DARK, lw=1.0, ls="--", label="all starts")
        for end, colour, label in zip(ends, (BLUE, LIGHT), ("idc", "refine alone"), strict=True):
            ax.step(np.sort(end), share, where="post", color=colour, lw=1.6, label=label)
        ax.set(xscale="log", xlabel=unit, ylim=(0, 1.02))
        ax.grid(color="#dddddd", linewidth=0.5)
    panels[0].set_ylabel("share of the pairs as near or nearer")
    panels[0].legend(fontsize=8, loc="upper left")
    return figure


def starts(truth: np.ndarray) -> np.ndarray:
    """Poses `(pairs, 3)` off the true ones, to random sides."""
    rng = np.random.default_rng(1)
    side = rng.uniform(-np.pi, np.pi, len(truth))
    turn = ANGLE * rng.choice([-1, 1], len(truth))
    offset = np.stack([DISTANCE * np.cos(side), DISTANCE * np.sin(side), turn], axis=-1)
    return np.asarray(compose(jnp.float32(truth), jnp.float32(offset)))


def pairs_of(split: Split, count: int) -> tuple[View, View, np.ndarray]:
    """Views of references and queries that overlap, and their true `T_ref_query` `(pairs, 3)`."""
    T_world_ref, T_world_query = split.T_world_ref, split.T_world_query
    hits = [_hits(scans) for scans in (split.references, split.queries)]
    rng = np.random.default_rng(0)
    chosen = []
    for q in rng.permutation(len(T_world_query)):
        off = np.hypot(*(T_world_ref - T_world_query[q])[:, :2].T)
        for r in rng.permutation(np.flatnonzero(off < FARTHEST))[:4]:
            there = transform(T_world_ref[r], hits[0][r])
            here = transform(T_world_query[q], hits[1][q])
            if min(_overlap(there, here), _overlap(here, there)) >= OVERLAP:
                chosen.append((r, q))
                break
        if len(chosen) == count:
            break
    r, q = np.array(chosen).T
    truth = relative(T_world_ref[r], T_world_query[q])
    return _views(split.references, r), _views(split.queries, q), truth


def _views(scans: aprjax.Scan, rows: np.ndarray) -> View:
    chosen = jax.tree.map(lambda array: np.asarray(array)[rows], scans)
    stacked = aprjax.ReferenceSet.build(chosen).index.features.view
    return jax.tree.map(lambda array: np.asarray(array)[: len(rows)], stacked)


def _hits(scans: aprjax.Scan) -> list[np.ndarray]:
    return [xy[hit] for xy, hit in zip(np.asarray(scans.points, float), scans.hit, strict=True)]


def _overlap(xy: np.ndarray, other: np.ndarray, jump: float = 0.5) -> float:
    """Share of the hits `xy` that lie on the other's surface: its hits, and lines between those.

    Neighbouring hits farther apart than `jump` metres are not joined.
    """
    if len(xy) == 0 or len(other) < 2:
        return 0.0
    start, along = other[:-1], np.diff(other, axis=0)
    square = (along**2).sum(axis=1)
    along, square = np.where(square[:, None] < jump**2, along, 0.0), np.maximum(square, 1e-9)
    off = xy[:, None] - start
    share = np.clip((off * along).sum(axis=-1) / square, 0.0, 1.0)
    gap = np.linalg.norm(off - share[..., None] * along, axis=-1).min(axis=1)
    gap = np.minimum(gap, np.linalg.norm(xy - other[-1], axis=1))
    return float(np.mean(gap < SURFACE))


if __name__ == "__main__":
    sys.exit(main())
