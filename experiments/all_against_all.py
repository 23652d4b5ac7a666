"""Every scan of a log against every other: the protocol of the FLIRT and FALKO papers.

    python -m experiments.all_against_all --out DIR [--quick] [LOG ...]

The pose graphs with scans (`*.graph.log.gz` of the data, see `data.py` for where): each scan is a
query, and all others are references. An answer is right within 0.5 m and 0.2 rad of the poses of
the graph's `VERTEX2` lines. Of the `KEPT` alternatives that are fully evaluated for a query, one
is chosen in three ways: the nearest to the truth (`oracle`), that on which most anchors agree
(`anchors`), and that of the highest quality (`quality`). The first can only be known afterwards;
it says what any choice could reach. Over a threshold on what is chosen by, answers are right,
wrong, or withheld (the oracle's are withheld by their quality).

Prints and writes `all_against_all.csv` (shares of all queries, and the time of a pair, description
of the queries included), `curves.csv`, `all_against_all.png` and `configuration.json` into DIR.
`--quick` takes every 16th scan of the first log.
"""

import argparse
import gzip
import sys
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import aprjax
from aprjax.metrics import deviations, world_poses
from aprjax.shortlist import ShortlistConfig
from experiments.data import data_root
from experiments.outputs import (
    BLUE,
    DARK,
    RED,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

RIGHT_DISTANCE, RIGHT_ANGLE = 0.5, 0.2  # metres and radians
KEPT = ShortlistConfig().kept
PIECE = 512  # queries between two lines of progress
CHOICES = {"oracle": DARK, "anchors": BLUE, "quality": RED}


def read_graph(path: Path, stride: int = 1) -> tuple[aprjax.Scan, np.ndarray]:
    """Stacked scans of a pose graph and the poses of its vertices `(scans, 3)`."""
    scans = [entry.scan for entry in aprjax.read_log(path)]
    with gzip.open(path, "rt") as lines:
        vertices = [line.split()[2:5] for line in lines if line.startswith("VERTEX2 ")]
    if len(vertices) != len(scans):
        raise SystemExit(f"{path}: {len(vertices)} vertices, but {len(scans)} scans")
    return aprjax.Scan.stack(scans[::stride]), np.array(vertices, float)[::stride]


def matched(scans: aprjax.Scan, name: str) -> tuple[aprjax.MatchResult, float]:
    """All evaluated alternatives of every scan among the others, and the seconds they took."""
    references = aprjax.ReferenceSet.build(scans)
    config = aprjax.MatchConfig(hypotheses=KEPT)
    count = len(references)
    size = min(PIECE, count)
    aprjax.warm_up(references, scans.ranges.shape[1], [size], config)
    pieces, seconds = [], 0.0
    for start in range(0, count, size):
        ids = references.ids[start : start + size]
        piece = jax.tree.map(lambda leaf: np.asarray(leaf)[ids], scans).pad_batch(size)  # noqa: B023
        others = np.pad(ids, (0, size - len(ids)), constant_values=-1)[:, None]
        begin = time.perf_counter()
        pieces.append(aprjax.match_batch(piece, references, config, exclude=others))
        seconds += time.perf_counter() - begin
        done = start + len(ids)
        print(f"{name}: {done} of {count}, {seconds:.0f} s", file=sys.stderr, flush=True)
    together = jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *pieces)
    return together, seconds


def chosen(result: aprjax.MatchResult, truth: np.ndarray) -> dict[str, tuple]:
    """For each way to choose: what the choice of each query scores, and whether it is right.

    `truth` `(queries, 3)` are the poses of the scans. Scores are 0 where there is no alternative.
    """
    poses = world_poses(result, np.arange(len(truth)), truth)
    gap, turn = deviations(poses, truth[:, None])
    right = result.valid & (gap < RIGHT_DISTANCE) & (turn < RIGHT_ANGLE)
    quality = np.where(result.valid, result.quality, 0.0)
    anchors = np.where(result.valid, result.agreeing_anchors, 0)
    by = {
        "oracle": right + quality,
        # Quality is less than 1: it decides among as many anchors.
        "anchors": anchors + quality,
        "quality": quality,
    }
    scores = {"oracle": quality, "anchors": anchors, "quality": quality}

    def of(name: str, array: Any) -> np.ndarray:
        return np.take_along_axis(array, np.argmax(by[name], axis=1)[:, None], axis=1)[:, 0]

    return {name: (of(name, scores[name]), of(name, right)) for name in CHOICES}


def curve(score: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Thresholds, highest first, and the shares of all queries answered right and wrong at each."""
    thresholds = np.unique(score[score > 0])[::-1]
    order = np.argsort(-score, kind="stable")
    answered = np.searchsorted(-score[order], -thresholds, side="right")
    hits = np.r_[0, np.cumsum(right[order])][answered]
    return thresholds, hits / len(score), (answered - hits) / len(score)


def at_most(share: float, hits: np.ndarray, wrong: np.ndarray) -> float:
    """The largest share of right answers with no more than this share of wrong ones."""
    return float(np.max(hits[wrong <= share], initial=0.0))


def drawn(curves: dict[str, dict[str, tuple]]) -> Figure:
    """One plot for each log: right against wrong answers."""
    figure = Figure(figsize=(4.2 * len(curves), 4.2), layout="constrained")
    axes = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    for ax, (name, of) in zip(axes, curves.items(), strict=True):
        for choice, (_, hits, wrong) in of.items():
            ax.plot(wrong, hits, color=CHOICES[choice], label=choice)
        ax.set_title(name)
        ax.set_xlabel("share of wrong answers")
        ax.set_xlim(left=0.0)
        ax.xaxis.set_major_locator(MaxNLocator(4))
        ax.set_ylim(0.0, 1.01)
        ax.grid(color="#dddddd", linewidth=0.5)
    axes[0].set_ylabel("share of right answers")
    axes[0].legend(loc="lower right", title="chosen by")
    return figure


def main() -> int:
    """Match, print, write; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    logs = {path.name.split(".")[0]: path for path in data_root().glob("logs/*.graph.log.gz")}
    parser.add_argument("logs", nargs="*", metavar="LOG", help=f"of {', '.join(sorted(logs))}")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="few scans of one log")
    arguments = parser.parse_args()
    names = arguments.logs or sorted(logs)[: 1 if arguments.quick else None]
    if unknown := set(names) - set(logs) or not names:
        parser.error(f"no such logs beneath {data_root()}: {unknown or 'none at all'}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    stride = 16 if arguments.quick else 1
    rows, curves = [], {}
    for name in names:
        scans, truth = read_graph(logs[name], stride)
        result, seconds = matched(scans, name)
        curves[name] = {how: curve(*answers) for how, answers in chosen(result, truth).items()}
        row = {"log": name, "scans": len(truth), "us_per_pair": 1e6 * seconds / len(truth) ** 2}
        for how, (_, hits, wrong) in curves[name].items():
            row[how] = hits[-1]
            row[f"{how}_at_1%_wrong"] = at_most(0.01, hits, wrong)
        rows.append({key: round(v, 4) if isinstance(v, float) else v for key, v in row.items()})
    print_table(rows)
    write_table(rows, arguments.out / "all_against_all.csv")
    points = [
        {"log": name, "choice": how, "threshold": float(t), "right": float(h), "wrong": float(w)}
        for name, of in curves.items()
        for how, each in of.items()
        for t, h, w in zip(*each, strict=True)
    ]
    write_table(points, arguments.out / "curves.csv")
    write_figure(drawn(curves), arguments.out / "all_against_all.png")
    write_configuration(arguments.out, logs=names, every=stride, hypotheses=KEPT)
    return 0


if __name__ == "__main__":
    sys.exit(main())
