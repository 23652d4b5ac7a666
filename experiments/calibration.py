"""The probability of being right, fitted to simulated floors.

    python -m experiments.calibration --out DIR [--quick]

Logistic regression over ln e_m of the best hypotheses on the simulated floors of seeds 10 to 15
(none of them is the demo's), a quarter of the weight on scans of another floor, which no
reference shows. Prints and writes the curve beside the package's own, `ProbabilityConfig`, as
`calibration.csv`, with the e_m at which right is as likely as wrong, and draws both over the shares
that were right, `calibration.png`; `configuration.json` is what made them. With few queries hardly
any e_m has both right and wrong ones, so the slope takes all floors. `real_logs.py` holds the
package's curve against real logs; nothing is fitted to them.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.evaluation.probability import ProbabilityConfig
from aprjax.metrics import is_right, world_poses
from aprjax.sim.lab import lab
from experiments.outputs import (
    BLUE,
    RED,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

SEEDS = range(10, 16)
STRANGE = 0.25  # share of scans that no reference shows
BINS = 12
COLOURS = {"fitted": BLUE, "package": RED}


@dataclass(frozen=True)
class Sample:
    """Best hypotheses `(n,)`, and how much each counts."""

    quality: np.ndarray
    """e_m, at least 0.001."""
    right: np.ndarray
    weight: np.ndarray


def sample(seeds: range, queries: int) -> Sample:
    """Each floor's queries, and those of the next one, matched with its references."""
    labs = [lab(seed, queries=queries) for seed in seeds]
    home, right, strange = [], [], []
    for known, other in zip(labs, [*labs[1:], labs[0]], strict=True):
        references = aprjax.ReferenceSet.build(known.references.scans)
        result = aprjax.match_batch(known.queries.scans, references)
        poses = world_poses(result, references.ids, known.references.T_world_laser)
        home.append(result.quality[:, 0])
        right.append(
            is_right(poses, known.queries.T_world_laser[:, None])[:, 0] & result.valid[:, 0]
        )
        strange.append(aprjax.match_batch(other.queries.scans, references).quality[:, 0])
    at_home, away = np.concatenate(home), np.concatenate(strange)
    return Sample(
        quality=np.maximum(np.concatenate([at_home, away]).astype(float), 1e-3),
        right=np.concatenate([*right, np.zeros(len(away), bool)]),
        weight=np.r_[
            np.full(len(at_home), (1 - STRANGE) / len(at_home)),
            np.full(len(away), STRANGE / len(away)),
        ],
    )


def fitted(best: Sample) -> tuple[float, float]:
    """Offset and slope of the logistic curve over ln e_m, by Newton's method."""
    columns = np.stack([np.ones_like(best.quality), np.log(best.quality)], axis=-1)
    curve = np.zeros(2)
    for _ in range(50):
        claimed = 1 / (1 + np.exp(-columns @ curve))
        gradient = columns.T @ (best.weight * (best.right - claimed))
        curvature = (columns * (best.weight * claimed * (1 - claimed))[:, None]).T @ columns
        curve = curve + np.linalg.solve(curvature + 1e-9 * np.eye(2), gradient)
    return float(curve[0]), float(curve[1])


def picture(best: Sample, curves: dict[str, tuple[float, float]]) -> Figure:
    """The curves over the shares that were right, in bins of equally many hypotheses."""
    figure = Figure(figsize=(6, 4), layout="constrained")
    ax = figure.add_subplot()
    for part in np.array_split(np.argsort(best.quality), BINS):
        share = np.average(best.right[part], weights=best.weight[part])
        ax.plot(np.exp(np.log(best.quality[part]).mean()), share, "o", color="#555555")
    e_m = np.linspace(1e-3, 1, 400)
    for name, (offset, slope) in curves.items():
        claimed = 1 / (1 + np.exp(-offset - slope * np.log(e_m)))
        ax.plot(
            e_m, claimed, color=COLOURS[name], label=f"{name}: {offset:.1f} + {slope:.1f} ln e_m"
        )
    ax.set(xlim=(0, 0.6), ylim=(-0.03, 1.03), xlabel="e_m", ylabel="share right in simulation")
    ax.grid(color="#dddddd", linewidth=0.5)
    ax.legend(loc="lower right", fontsize=8)
    return figure


def main() -> int:
    """Fit, compare, write; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="two floors, fewer queries")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)

    seeds, queries = (SEEDS[:2], 50) if arguments.quick else (SEEDS, 300)
    best = sample(seeds, queries)
    own = ProbabilityConfig()
    curves = {"fitted": fitted(best), "package": (float(own.offset), float(own.slope))}
    rows = [
        {
            "curve": name,
            "offset": round(offset, 3),
            "slope": round(slope, 3),
            "even_e_m": round(float(np.exp(-offset / slope)), 4),
        }
        for name, (offset, slope) in curves.items()
    ]
    write_table(rows, arguments.out / "calibration.csv")
    print_table(rows)
    write_figure(picture(best, curves), arguments.out / "calibration.png")
    write_configuration(arguments.out, seeds=list(seeds), queries=queries, strange=STRANGE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
