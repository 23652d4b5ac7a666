"""Figure 1 of the paper on real scans, and how repeatable the anchors are.

    python -m experiments.anchors --out DIR [--quick]

Reads corrected logs (see `data.py` for where). Writes `figure1.png`, `repeatability.csv`,
`scans.csv` and `configuration.json` into DIR.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import Anchors, ExtractionConfig, choose_anchors
from aprjax.anchors.segment import segment
from aprjax.anchors.surface import surface
from aprjax.metrics import reappearing
from aprjax.plane import relative
from aprjax.plot.anchors import draw_anchors
from aprjax.plot.scan import draw_scan
from aprjax.relations.graph import anchor_graph
from experiments.data import corrected_log
from experiments.outputs import print_table, write_configuration, write_figure, write_table

FIGURE = (("freiburg-079", 117), ("fhw", 54), ("intel", 364))
LOGS = ("freiburg-079", "intel")
WITHIN = ((0.5, 20.0), (1.0, 30.0), (2.0, 30.0))  # metres, degrees
APART = 0.1  # metres at least between the scans of a pair: a robot at rest repeats anything
RADIUS = 0.1  # metres within which an anchor reappears
CHUNK = 64


@dataclass(frozen=True)
class Described:
    """The scans of a log with their anchors and true poses."""

    scans: aprjax.Scan
    """Stacked."""
    poses: np.ndarray
    """`(scans, 3)` true laser poses in metres and radians."""
    anchors: Anchors
    small: float
    """Share of the hits on parts that the segmentation removes as small."""


@jax.jit
def _extract(scans: aprjax.Scan, config: ExtractionConfig):
    def one(scan):
        segments = segment(scan, config.segment)
        anchors = choose_anchors(segments, surface(segments, config.surface), config)
        return anchors, segments.hit & ~segments.large, segments.hit

    return jax.vmap(one)(scans)


def read(path: Path, step: int) -> Described:
    """Every `step`-th scan of a corrected log, whose FLASER poses are the truth."""
    entries = [entry for i, entry in enumerate(aprjax.read_log(path)) if i % step == 0]
    poses = np.array([entry.logged_pose for entry in entries], float)
    return describe(aprjax.Scan.stack([entry.scan for entry in entries]), poses)


def describe(scans: aprjax.Scan, poses: np.ndarray) -> Described:
    """Stacked scans from true poses `(scans, 3)` with their anchors."""
    count = len(poses)
    padded = scans.pad_batch(-(-count // CHUNK) * CHUNK)
    chunks = [
        jax.tree.map(
            np.asarray,
            _extract(
                jax.tree.map(lambda a: a[start : start + CHUNK], padded),  # noqa: B023
                ExtractionConfig(),
            ),
        )
        for start in range(0, count, CHUNK)
    ]
    anchors, small, hit = jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *chunks)
    return Described(scans, poses, anchors, float(small.sum() / hit.sum()))


def one(log: Described, index: int) -> tuple[aprjax.Scan, Anchors]:
    """One scan and its anchors."""
    scan, anchors = jax.tree.map(lambda array: array[index], (log.scans, log.anchors))
    return scan, anchors


def in_sight(scan: aprjax.Scan, xy: np.ndarray) -> np.ndarray:
    """Which points `(points, 2)` lie before the surface that the scan saw in their direction."""
    bearing = np.arctan2(xy[:, 1], xy[:, 0])
    step, beams = float(scan.angle_increment), int(scan.beams)
    beam = np.round((bearing - float(scan.angle_min)) / step).astype(int)
    ranges = np.where(np.isfinite(scan.ranges), scan.ranges, np.inf)[:beams]
    inside = (beam >= 0) & (beam < beams)
    return inside & (ranges[np.clip(beam, 0, beams - 1)] > np.hypot(xy[:, 0], xy[:, 1]))


def repeatability_rows(name: str, log: Described, pairs: int, radius: float) -> list[dict]:
    """One row for each class of pairs: shares of all anchors and of each kind."""
    rng = np.random.default_rng(0)
    classes = [np.zeros((2, 1 + len(Kind)), int) for _ in WITHIN]
    counts = np.zeros(len(WITHIN), int)
    for a in rng.permutation(len(log.poses)):
        if counts.min() >= pairs:
            break
        T_a_b = relative(log.poses[a], log.poses)
        distance = np.hypot(T_a_b[:, 0], T_a_b[:, 1])
        turn = np.degrees(np.abs(T_a_b[:, 2]))
        near = np.flatnonzero((distance >= APART) & (distance <= WITHIN[-1][0]))
        scan_a, _ = one(log, a)
        # A pair of which only b sees a comes up when b is drawn.
        seen = in_sight(scan_a, T_a_b[near, :2])
        for k, (most, angle) in enumerate(WITHIN):
            here = near[seen & (distance[near] <= most) & (turn[near] <= angle)]
            if counts[k] >= pairs or not len(here):
                continue
            b = int(rng.choice(here))
            # Both ways: what a has is looked for in b, and the other way round.
            for first, second in ((a, b), (b, a)):
                _, anchors_1 = one(log, first)
                scan_2, anchors_2 = one(log, second)
                T_1_2 = relative(log.poses[first], log.poses[second])
                masks = reappearing(anchors_1, anchors_2, T_1_2, radius, scan_2)
                kinds = np.asarray(anchors_1.kind)
                for row, mask in enumerate(masks):
                    by_kind = np.bincount(kinds[mask], minlength=len(Kind))
                    classes[k][row] += np.r_[mask.sum(), by_kind]
            counts[k] += 1
    return [
        {
            "log": name,
            "within_m": most,
            "within_deg": angle,
            "pairs": int(counts[k]),
            "counted": int(classes[k][0, 0]),
            **{
                column: round(float(found / counted), 3) if counted else ""
                for column, counted, found in zip(
                    ("all", *(kind.name.lower() for kind in Kind)), *classes[k], strict=True
                )
            },
        }
        for k, (most, angle) in enumerate(WITHIN)
    ]


def scan_row(name: str, log: Described) -> dict:
    """Anchors per scan, by kind, and the share of hits removed as small."""
    valid, kinds = np.asarray(log.anchors.valid), np.asarray(log.anchors.kind)
    return {
        "log": name,
        "scans": len(valid),
        "anchors": round(float(valid.sum(axis=1).mean()), 2),
        **{
            kind.name.lower(): round(float((valid & (kinds == kind)).sum(axis=1).mean()), 2)
            for kind in Kind
        },
        "at_capacity": round(float(np.mean(np.asarray(log.anchors.overflow) > 0)), 3),
        "small_share": round(log.small, 3),
    }


def figure1(examples: list[tuple[str, int, aprjax.Scan, Anchors]], path: Path) -> None:
    """A column for each example: above the scan with its anchors, below the graph."""
    figure = Figure(figsize=(4.6 * len(examples), 9.0), layout="constrained")
    grid = figure.subplots(2, len(examples), sharex="col", sharey="col", squeeze=False)
    for (above, below), (name, index, scan, anchors) in zip(grid.T, examples, strict=True):
        draw_scan(scan, ax=above)
        draw_anchors(anchors, ax=above)
        draw_anchors(anchors, anchor_graph(anchors), ax=below)
        above.set_title(f"{name}, scan {index}: {above.get_title()}", fontsize=10)
    named = {}
    for ax in grid.flat:
        named |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
        ax.get_legend().remove()
    figure.legend(
        named.values(), named, loc="outside lower center", ncols=len(named), frameon=False
    )
    write_figure(figure, path, dpi=85)


def main() -> int:
    """Make the figure and the tables; the exit status."""
    parser = argparse.ArgumentParser(description="Figure 1 and the repeatability of anchors.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="fewer scans and pairs")
    arguments = parser.parse_args()

    paths = {name: corrected_log(name) for name, _ in FIGURE}
    arguments.out.mkdir(parents=True, exist_ok=True)

    examples = []
    for name, index in FIGURE:
        scan = next(e.scan for i, e in enumerate(aprjax.read_log(paths[name])) if i == index)
        stacked = aprjax.Scan.stack([scan]).pad_batch(CHUNK)
        anchors, _, _ = _extract(stacked, ExtractionConfig())
        examples.append((name, index, scan, jax.tree.map(lambda array: array[0], anchors)))
    figure1(examples, arguments.out / "figure1.png")

    pairs = 100 if arguments.quick else 500
    # Freiburg's log has a scan every 9 cm; a fifth of them leaves pairs enough.
    every = {
        name: (5 if name == "freiburg-079" else 1) * (4 if arguments.quick else 1) for name in LOGS
    }
    repeated, described = [], []
    for name in LOGS:
        log = read(paths[name], every[name])
        repeated += repeatability_rows(name, log, pairs, RADIUS)
        described.append(scan_row(name, log))
    for rows, name in ((repeated, "repeatability"), (described, "scans")):
        write_table(rows, arguments.out / f"{name}.csv")
        print_table(rows)
    write_configuration(
        arguments.out, figure=FIGURE, logs=LOGS, every=every, pairs=pairs, within=WITHIN,
        apart=APART, radius=RADIUS,
    )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
