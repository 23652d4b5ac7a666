"""The probability of being right: fitted to simulated floors, held against real logs.

`python experiments/calibration.py --out DIR [--quick]`

Logistic regression over ln e_m of the best hypotheses on the simulated floors of seeds 10 to 15
(none of them is the demo's), a quarter of the weight on scans of another floor, which no
reference shows. Prints the curve beside the package's own, `ProbabilityConfig`, and the expected
calibration error of the package's on each real log: all queries, wherever they were taken, ten
bins. Writes `calibration.csv` and the reliability diagrams, `calibration.png`. The real logs are
looked for in the folder `APRJAX_DATA`, else in `../shared/data` beside the repository; no
parameter is fitted to them.
"""

import argparse
import csv
import os
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import aprjax
from aprjax.evaluation.probability import ProbabilityConfig
from aprjax.io.atomic import atomic_write
from aprjax.metrics import is_right, reliability, world_poses
from aprjax.plot.reliability import draw_reliability
from aprjax.sim.lab import lab

SEEDS = range(10, 16)
STRANGE = 0.25  # share of scans that no reference shows


def main() -> int:
    """Fit, compare, write; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="two floors, every eighth query")
    arguments = parser.parse_args()
    beside = Path(__file__).resolve().parents[1].parent / "shared" / "data"
    folder = Path(os.environ.get("APRJAX_DATA") or beside) / "splits"
    if not folder.is_dir():
        print(f"calibration: no splits in {folder}; set APRJAX_DATA", file=sys.stderr)
        return 1

    offset, slope = fitted(SEEDS[:2] if arguments.quick else SEEDS, 50 if arguments.quick else 300)
    own = ProbabilityConfig()
    print(f"fitted: offset {offset:.2f}, slope {slope:.2f}")
    print(f"package: offset {float(own.offset):.2f}, slope {float(own.slope):.2f}")

    arguments.out.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(2, 4, figsize=(13, 6.8), layout="constrained")
    rows = []
    for path, ax in zip(sorted(folder.iterdir()), axes.flat, strict=False):
        claimed, right = on_real_log(path, 8 if arguments.quick else 1)
        draw_reliability(claimed, right, path.name, ax)
        error = reliability(claimed, right).error
        rows.append(
            {"split": path.name, "queries": len(right), "calibration_error": f"{error:.4f}"}
        )
        print(f"{path.name:26s} {len(right):4d} queries, {right.mean():.3f} right: {error:.3f}")
    figure.savefig(arguments.out / "calibration.png", dpi=130)
    with atomic_write(arguments.out / "calibration.csv", "w") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return 0


def fitted(seeds: range, queries: int) -> tuple[float, float]:
    """Offset and slope of the logistic curve over ln e_m, by Newton's method."""
    labs = [lab(seed, queries=queries) for seed in seeds]
    quality, right, strange = [], [], []
    for known, other in zip(labs, [*labs[1:], labs[0]], strict=True):
        references = aprjax.ReferenceSet.build(known.references.scans)
        result = aprjax.match_batch(known.queries.scans, references)
        poses = world_poses(result, references.ids, known.references.T_world_laser)
        quality.append(result.quality[:, 0])
        right.append(
            is_right(poses, known.queries.T_world_laser[:, None])[:, 0] & result.valid[:, 0]
        )
        strange.append(aprjax.match_batch(other.queries.scans, references).quality[:, 0])
    at_home, away = np.concatenate(quality), np.concatenate(strange)
    e_m = np.maximum(np.concatenate([at_home, away]), 1e-3)
    truth = np.concatenate([*right, np.zeros(len(away))])
    weight = np.r_[
        np.full(len(at_home), (1 - STRANGE) / len(at_home)), np.full(len(away), STRANGE / len(away))
    ]
    columns = np.stack([np.ones_like(e_m), np.log(e_m)], axis=-1).astype(float)
    curve = np.zeros(2)
    for _ in range(50):
        claimed = 1 / (1 + np.exp(-columns @ curve))
        gradient = columns.T @ (weight * (truth - claimed))
        curvature = (columns * (weight * claimed * (1 - claimed))[:, None]).T @ columns
        curve = curve + np.linalg.solve(curvature + 1e-9 * np.eye(2), gradient)
    return float(curve[0]), float(curve[1])


def on_real_log(folder: Path, stride: int) -> tuple[np.ndarray, np.ndarray]:
    """Claimed probability of each query's best hypothesis, and whether it is right."""
    references = list(aprjax.read_log(folder / "references.log.gz"))
    queries = list(aprjax.read_log(folder / "queries.log.gz"))[::stride]
    known = aprjax.ReferenceSet.build([entry.scan for entry in references])
    result = aprjax.match_batch([entry.scan for entry in queries], known)
    T_world_ref = np.array([entry.logged_pose for entry in references])
    T_world_query = np.array([entry.logged_pose for entry in queries])
    poses = world_poses(result, known.ids, T_world_ref)
    right = is_right(poses, T_world_query[:, None])[:, 0] & result.valid[:, 0]
    return np.asarray(result.probability)[:, 0], right


if __name__ == "__main__":
    sys.exit(main())
