"""Errors of the matcher's poses in the simulated lab, and whether their covariances cover them.

    python -m experiments.pose_error --out DIR [--quick]

The queries of several seeds of the lab are matched globally with its references. Best hypotheses
that are right (within 0.5 m and 10° of the truth) are counted: their median errors, the mean of
e' C⁻¹ e, where e is the error of (x, y, theta) and C its covariance, which is 3 for a perfect
estimate of C, the same without the worst one, and the share that lies inside the 95 % region.
Writes `pose_error.csv`, `pose_error.png` and `configuration.json` into DIR.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import aprjax
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

REGION = 7.815  # the 95 % quantile of chi-square with three degrees of freedom
EXPECTED = RED


def errors(seed: int, queries: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors `(n, 3)` and covariances `(n, 3, 3)` of right best hypotheses, in a lab of a seed.

    Both are in the reference's frame, in metres and radians.
    """
    place = lab(seed, queries=queries)
    references = aprjax.ReferenceSet.build(place.references.scans)
    result = aprjax.match_batch(place.queries.scans, references)
    T_world_ref, T_world_query = place.references.T_world_laser, place.queries.T_world_laser
    poses = world_poses(result, references.ids, T_world_ref)[:, 0]
    right = result.valid[:, 0] & is_right(poses, T_world_query)

    T_world_ref = T_world_ref[np.searchsorted(references.ids, result.reference[right, 0])]
    off = poses[right] - T_world_query[right]
    cos, sin = np.cos(T_world_ref[:, 2]), np.sin(T_world_ref[:, 2])
    x, y = cos * off[:, 0] + sin * off[:, 1], cos * off[:, 1] - sin * off[:, 0]
    turn = np.angle(np.exp(1j * off[:, 2]))
    return np.stack([x, y, turn], axis=-1), np.asarray(result.covariance, float)[right, 0]


def normalised(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Squared errors over their covariances `(n,)`."""
    return np.sum(error * np.linalg.solve(covariance, error[..., None])[..., 0], axis=-1)


def row(name: str, error: np.ndarray, square: np.ndarray) -> dict:
    """What came of one lab."""
    gap, turn = np.hypot(error[:, 0], error[:, 1]), np.degrees(np.abs(error[:, 2]))
    return {
        "lab": name,
        "right": len(error),
        "median_m": round(float(np.median(gap)), 4),
        "p95_m": round(float(np.quantile(gap, 0.95)), 4),
        "median_deg": round(float(np.median(turn)), 4),
        "p95_deg": round(float(np.quantile(turn, 0.95)), 4),
        "mean_normalised": round(float(np.mean(square)), 3),
        "without_worst": round(float(np.mean(np.sort(square)[:-1])), 3),
        "inside_95": round(float(np.mean(square <= REGION)), 4),
    }


def picture(error: np.ndarray, square: np.ndarray, path: Path) -> None:
    """Distributions of the errors, and of what they are over their covariances."""
    figure = Figure(figsize=(12, 3.6), layout="constrained")
    distance, angle, histogram = figure.subplots(1, 3)
    share = np.arange(1, len(error) + 1) / len(error)
    for ax, values, unit in (
        (distance, 100 * np.hypot(error[:, 0], error[:, 1]), "distance from the truth / cm"),
        (angle, np.degrees(np.abs(error[:, 2])), "angle from the truth / °"),
    ):
        ax.step(np.sort(values), share, where="post", color=BLUE)
        ax.set_xscale("log")
        ax.set_xlabel(unit)
        ax.set_ylabel("share of right hypotheses")
        ax.set_ylim(0, 1)
        ax.grid(color="#dddddd", linewidth=0.5)
    edges = np.linspace(0, 15, 31)
    # What lies beyond is counted in the last bin, so that none is left out of sight.
    histogram.hist(
        np.minimum(square, edges[-1] - 1e-6), edges, density=True, color=BLUE, alpha=0.6,
        label="found; beyond 15 in the last bin",
    )  # fmt: skip
    x = np.linspace(0, 15, 301)
    density = np.sqrt(x / (2 * np.pi)) * np.exp(-x / 2)
    histogram.plot(x, density, color=EXPECTED, label="chi-square, 3 degrees of freedom")
    histogram.axvline(REGION, color=EXPECTED, linestyle=":", label="95 % region")
    histogram.set_xlabel("squared error over covariance")
    histogram.set_ylabel("density")
    histogram.legend(fontsize=8, framealpha=1, edgecolor="none", loc="upper right")
    write_figure(figure, path)


def main() -> int:
    """Print and write the table and the picture; the exit status."""
    parser = argparse.ArgumentParser(description="Errors and covariances in the simulated lab.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="fewer labs and queries")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)

    seeds, queries = (range(2), 100) if arguments.quick else (range(6), 400)
    found = [errors(seed, queries) for seed in seeds]
    squares = [normalised(*one) for one in found]
    rows = [
        row(str(seed), error, square)
        for seed, (error, _), square in zip(seeds, found, squares, strict=True)
    ]
    error, square = np.concatenate([error for error, _ in found]), np.concatenate(squares)
    total = row("all", error, square)
    write_table([*rows, total], arguments.out / "pose_error.csv")
    print_table([*rows, total])
    picture(error, square, arguments.out / "pose_error.png")
    write_configuration(arguments.out, seeds=list(seeds), queries=queries)
    return 0


if __name__ == "__main__":
    sys.exit(main())
