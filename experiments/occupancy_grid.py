"""Global localization in an occupancy grid: a map drawn by one run, scans of another matched in it.

    python -m experiments.occupancy_grid --out DIR [--quick] [--track NAME] [--resolution M]

The build run of a track (default: fhw.revisit) is drawn as an occupancy grid at its true poses,
written as a map_server YAML and PGM, and read back. Viewpoints that cover its floor become
reference scans, rendered from the grid with 360 beams all around; they and nothing else of the
build run are what the track run's scans are matched with, one by one and without any prior. An
answer is right within 0.5 m and 10° of the truth; a scan is mapped when a pose of the build run
lies within 2 m and 40° of it. See `data.py` for where the logs lie.

Prints, and writes into DIR: `occupancy_grid.csv` (shares of the mapped scans that are right, and
that are right and `confident`; confident ones that are wrong, of all scans), `map.yaml` and
`map.pgm`, `grid.png`, the grid with its viewpoints and the answers, and `configuration.json`. The
exit status is 1 if less than 0.90 of the mapped scans are right.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import aprjax
from aprjax.io.trajectory import read_tum
from aprjax.metrics import deviations, is_right, world_poses
from aprjax.plot.grid import draw_grid
from aprjax.plot.style import figure_of
from experiments.data import track_folder
from experiments.outputs import print_table, write_configuration, write_figure, write_table

LEAST = 0.90
NEAR, TURNED = 2.0, np.radians(40.0)  # of a build pose from a mapped scan


def main() -> int:
    """Draw, render, match, score; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="every fourth scan of the track")
    parser.add_argument("--track", default="fhw.revisit", metavar="NAME")
    parser.add_argument("--resolution", type=float, default=0.05, metavar="M")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    build, T_world_build = run_of(arguments.track, "build")
    drawn = aprjax.grid_from_scans(
        aprjax.Scan.stack(build), T_world_build, resolution=arguments.resolution
    )
    aprjax.write_occupancy_grid(drawn, arguments.out / "map.yaml")
    grid = aprjax.read_occupancy_grid(arguments.out / "map.yaml")

    began = time.perf_counter()
    references = aprjax.ReferenceSet.from_occupancy_grid(grid)
    seconds = time.perf_counter() - began
    every = 4 if arguments.quick else 1
    track, T_world_track = run_of(arguments.track, "track", every)
    mapped = near_any(T_world_track, T_world_build)
    result = aprjax.match_batch(track, references)
    found = world_poses(result, references.ids, references.T_world_ref)[:, 0]
    valid, confident = np.asarray(result.valid)[:, 0], np.asarray(result.confident)
    right = valid & is_right(found, T_world_track)
    gap, turn = deviations(found[right], T_world_track[right])
    row = {
        "track": arguments.track,
        "cells": f"{grid.cells.shape[1]} x {grid.cells.shape[0]}",
        "resolution_m": grid.resolution,
        "references": len(references),
        "build_s": f"{seconds:.1f}",
        "scans": len(track),
        "mapped": int(mapped.sum()),
        "right": f"{right[mapped].mean():.3f}",
        "confident_right": f"{(confident & right)[mapped].mean():.3f}",
        "confident_wrong": f"{(confident & ~right).mean():.3f}",
        "median_m": f"{np.median(gap):.3f}",
        "median_deg": f"{np.degrees(np.median(turn)):.2f}",
    }
    print_table([row])
    write_table([row], arguments.out / "occupancy_grid.csv")
    drawn = draw_grid(
        grid, references.T_world_ref, right=T_world_track[right], wrong=T_world_track[~right]
    )
    write_figure(figure_of(drawn), arguments.out / "grid.png")
    write_configuration(
        arguments.out, track=arguments.track, every=every, resolution=arguments.resolution
    )
    return 0 if right[mapped].mean() >= LEAST else 1


def run_of(track: str, name: str, stride: int = 1) -> tuple[list[aprjax.Scan], np.ndarray]:
    """Every `stride`-th scan of a run, and the true poses `(N, 3)` of their laser."""
    folder = track_folder(track)
    scans = [entry.scan for entry in aprjax.read_log(folder / f"{name}.log.gz")]
    return scans[::stride], read_tum(folder / f"{name}.tum")[1][::stride]


def near_any(poses: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which `poses` `(N, 3)` lie near one of the others `(M, 3)`: a mask `(N,)`."""
    gap, turn = deviations(poses[:, None], others[None])
    return np.any((gap < NEAR) & (turn < TURNED), axis=1)


if __name__ == "__main__":
    sys.exit(main())
