"""Localization on real drives, in maps built from other drives or from every other part.

`python -m experiments.tracks [TRACK ...] --out DIR [--maps DIR] [--variants] [--quick]`

Builds the map of each track from its build log, as `aprjax map build` does, and localizes the track
in it, as `aprjax localize` does, from raw odometry and scans; see `data.py` for where the logs lie.
With `--maps`, maps are kept in that folder and those already there are used.

Prints and writes `tracks.csv`. right: scans taken where the map is whose strongest hypothesis is
within 0.5 m and 10° of the truth; committed_right: that with λ over 0.5; committed_wrong: scans
whose hypothesis over 0.5 is wrong, of all; metres until the first committed and right one, and
after each kidnapping, the median and the worst. Beside them a particle filter in its best case:
MRPT's, likelihood field on a 5 cm grid drawn at the true poses, uniform start, adaptive up to
40 000 particles; on the track with kidnappings with random injection as in augmented MCL. Its
figures are cited. match_ms: matching a scan with all references in a batch; rest_ms: all else of a
step, the median CPU time; step_ms: whole steps as a robot makes them, one scan at a time, the
median of fifty. Compilation apart. Writes also a hypothesis table for each track,
`TRACK.csv`, and draws `tracks.png`: the error of the strongest hypothesis and λ_b over the way.
With `--variants`, `variants.csv` has the same figures without iterative dual correspondence, with
scan classes besides, and by odometry alone, without scans aligned one with the next.
"""

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.io.tables import HypothesisRow, write_hypotheses
from aprjax.io.trajectory import read_tum
from aprjax.metrics import deviations, is_near, is_right
from aprjax.plane import compose
from aprjax.tracking.apr import MatchedSource
from aprjax.tracking.belief import Belief
from aprjax.tracking.classes import scan_source
from aprjax.tracking.odometry import WheelOdometry
from aprjax.tracking.replay import matched
from aprjax.tracking.table import hypothesis_rows
from aprjax.tracking.validation import IdcSource
from experiments.data import data_root, track_folder
from experiments.outputs import (
    BLUE,
    DARK,
    RED,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

CITED = {
    "fhw.revisit": (0.99, 0.026, ""),
    "freiburg-079.revisit": (0.89, 0.317, ""),
    "belgioioso.interleaved": (0.99, 0.007, ""),
    "csail.interleaved": (0.93, 0.064, ""),
    "aces.interleaved.kidnap": (0.81, 0.163, "8 of 8, 5.5"),
}
"""The particle filter: right, committed and wrong, recovery."""
TIMED = 50
QUICK = "belgioioso.interleaved"


@dataclass(frozen=True)
class Track:
    """The truth of a track: only to score with."""

    T_world_build: np.ndarray
    """`(build scans, 3)`."""
    T_world_laser: np.ndarray
    """`(scans, 3)`."""
    starts: np.ndarray
    """Numbers of the first scan, and of the first one after each kidnapping."""

    @classmethod
    def read(cls, folder: Path) -> "Track":
        """The truth in a track's folder."""
        jumps = folder / "kidnapped_at.txt"
        kidnapped = np.loadtxt(jumps, dtype=int, ndmin=1) if jumps.exists() else np.zeros(0, int)
        return cls(
            read_tum(folder / "build.tum")[1],
            read_tum(folder / "track.tum")[1],
            np.concatenate([[0], kidnapped]),
        )

    @property
    def mapped(self) -> np.ndarray:
        """`(scans,)`: a scan of the build log was taken nearby."""
        return np.any(is_near(self.T_world_build, self.T_world_laser[:, None]), axis=1)

    @property
    def steps(self) -> np.ndarray:
        """Metres from the scan before, `(scans,)`; none across a kidnapping."""
        step = np.concatenate([[0], np.hypot(*np.diff(self.T_world_laser[:, :2], axis=0).T)])
        step[self.starts] = 0.0
        return step


def main() -> int:
    """Build, localize, print, write; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tracks", nargs="*", help="names of tracks (default: all)")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--maps", type=Path, metavar="DIR", help="keep maps here")
    parser.add_argument(
        "--quick", action="store_true", help=f"{QUICK}, its first 60 scans, and no single steps"
    )
    parser.add_argument("--variants", action="store_true", help="with other sources too")
    arguments = parser.parse_args()
    there = sorted(path.name for path in (data_root() / "tracks").glob("*"))
    names = [QUICK] if arguments.quick else arguments.tracks or there
    arguments.out.mkdir(parents=True, exist_ok=True)

    rows, others, drawn = [], [], {}
    for name in names:
        folder = track_folder(name)
        print(name, file=sys.stderr, flush=True)
        world = map_of(folder, arguments.maps)
        entries = list(aprjax.read_log(folder / "track.log.gz"))
        truth = Track.read(folder)
        if arguments.quick:
            entries = entries[:60]
            truth = Track(truth.T_world_build, truth.T_world_laser[:60], truth.starts[:1])
        results, matching = answers(world, entries)
        beliefs, rest = localized(defaults(world), results)
        times = {"match_ms": matching, "rest_ms": rest}
        table = hypothesis_rows(world, beliefs)
        write_hypotheses(arguments.out / f"{name}.csv", table)
        if not arguments.quick:
            times["step_ms"] = single_steps(world, entries[:TIMED])
        right, cited = CITED.get(name, ("", "", ""))[0], CITED.get(name, ("", "", ""))[1:]
        rows.append(
            {
                "track": name,
                **score(truth, table),
                "filter_right": right,
                "filter_committed_wrong": cited[0],
                "filter_recovery": cited[1],
                "references": len(world.appearances),
                **{key: round(value, 1) for key, value in times.items()},
            }
        )
        drawn[name] = truth, table
        for variant, tracker in (VARIANTS if arguments.variants else {}).items():
            table = hypothesis_rows(world, localized(tracker(world), results)[0])
            others.append({"track": name, "sources": variant, **score(truth, table)})
    print_table(rows)
    if others:
        print_table(others)
        write_table(others, arguments.out / "variants.csv")
    write_table(rows, arguments.out / "tracks.csv")
    write_figure(draw(drawn), arguments.out / "tracks.png")
    write_configuration(arguments.out, tracks=names)
    return 0


def map_of(folder: Path, kept: Path | None) -> aprjax.WorldModel:
    """The map of a track's build log, built or as it was kept."""
    path = None if kept is None else kept / f"{folder.name}.map"
    if path is not None and path.exists():
        return aprjax.load_map(path)
    world = aprjax.build_map(aprjax.read_log(folder / "build.log.gz"))
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        aprjax.save_map(world, path)
    return world


def answers(
    world: aprjax.WorldModel, entries: list[aprjax.LogEntry]
) -> tuple[list[tuple[aprjax.LogEntry, aprjax.MatchResult]], float]:
    """What the matcher makes of each scan, and milliseconds of CPU time for one."""
    list(matched(world, entries[:1] * min(len(entries), 64)))  # compiles
    began = time.process_time()
    results = list(matched(world, entries))
    return results, 1e3 * (time.process_time() - began) / len(entries)


def defaults(world: aprjax.WorldModel, **sources: Any) -> aprjax.HypothesisTracker:
    """A tracker that takes the answers of the matcher, with other sources if they are told."""
    return aprjax.HypothesisTracker(world, primary=[MatchedSource()], **sources)


VARIANTS = {
    "no dual correspondence": lambda world: defaults(world, validation=[]),
    "scan classes too": lambda world: defaults(world, validation=[IdcSource(), scan_source(world)]),
    "odometry alone": lambda world: defaults(world, tracking=[WheelOdometry()]),
}


def localized(
    tracker: aprjax.HypothesisTracker,
    results: list[tuple[aprjax.LogEntry, aprjax.MatchResult]],
) -> tuple[list[Belief], float]:
    """What is believed after each scan, and the median step's milliseconds of CPU time."""
    beliefs, spent = [], []
    for entry, match in results:
        began = time.process_time()
        tracker.move(odometry=entry.odometry, scan=entry.scan)
        beliefs.append(tracker.observe(match=match, scan=entry.scan))
        spent.append(time.process_time() - began)
    return beliefs, 1e3 * float(np.median(spent))


def single_steps(world: aprjax.WorldModel, entries: list[aprjax.LogEntry]) -> float:
    """Milliseconds by the clock of a step with everything, one scan at a time: the median."""
    tracker = aprjax.HypothesisTracker(world)
    spent = []
    for entry in entries:
        began = time.perf_counter()
        tracker.move(odometry=entry.odometry, scan=entry.scan)
        tracker.observe(scan=entry.scan)
        spent.append(time.perf_counter() - began)
    return 1e3 * float(np.median(spent))


def strongest(truth: Track, table: list[HypothesisRow]) -> tuple[np.ndarray, np.ndarray]:
    """Poses `(scans, 3)` of the strongest hypotheses in the world, NaN for none, and their λ."""
    poses, probability = np.full((len(truth.T_world_laser), 3), np.nan), np.zeros(len(truth.steps))
    for row in table:
        if row.rank == 0 and row.reference is not None and row.T_ref_laser is not None:
            poses[row.scan] = compose(truth.T_world_build[row.reference], row.T_ref_laser)
            probability[row.scan] = row.probability
    return poses, probability


def score(truth: Track, table: list[HypothesisRow]) -> dict:
    """Figures of a track."""
    poses, probability = strongest(truth, table)
    right, committed = is_right(poses, truth.T_world_laser), probability > 0.5
    mapped, steps = truth.mapped, truth.steps
    metres, found = [], 0
    for start, end in zip(truth.starts, [*truth.starts[1:], len(steps)], strict=True):
        good = np.flatnonzero((right & committed)[start:end])
        found += len(good) > 0
        metres.append(steps[start : start + good[0] + 1 if len(good) else end].sum())
    kidnapped = len(metres) > 1
    recovered = found - bool((right & committed)[: [*truth.starts[1:], len(steps)][0]].any())
    return {
        "right": round(float(right[mapped].mean()), 3),
        "committed_right": round(float((right & committed)[mapped].mean()), 3),
        "committed_wrong": round(float((committed & ~right).mean()), 3),
        "first_fix_m": round(float(metres[0]), 1),
        "recovered": f"{recovered} of {len(metres) - 1}" if kidnapped else "",
        "recovery_m": round(float(np.median(metres[1:])), 1) if kidnapped else "",
        "worst_m": round(float(np.max(metres[1:])), 1) if kidnapped else "",
    }


def draw(tracks: dict[str, tuple[Track, list[HypothesisRow]]]) -> Figure:
    """The strongest hypotheses' errors and probabilities over the way."""
    figure = Figure(figsize=(11, 2.0 * len(tracks) + 0.6), layout="constrained")
    panels = figure.subplots(len(tracks), 1, squeeze=False)[:, 0]
    for ax, (name, (truth, table)) in zip(panels, tracks.items(), strict=True):
        poses, probability = strongest(truth, table)
        gap = np.clip(deviations(poses, truth.T_world_laser)[0], 0.01, 100.0)
        way = np.cumsum(truth.steps)
        ax.semilogy(way, gap, ".", color=RED, ms=3, label="error of the strongest / m")
        ax.axhline(0.5, color=RED, lw=0.6, ls="--")
        ax.fill_between(
            way, 0, 1, where=~truth.mapped, color="#e6e2d8", lw=0,
            transform=ax.get_xaxis_transform(), label="not mapped",
        )  # fmt: skip
        for start in truth.starts[1:]:
            ax.axvline(way[start], color=DARK, lw=0.8)
        beside = ax.twinx()
        beside.plot(way, probability, color=BLUE, lw=0.9)
        beside.set_ylim(0, 1.02)
        beside.set_ylabel("$\\lambda_b$", color=BLUE)
        ax.set_title(name, fontsize=10, loc="left")
        ax.set_xlim(0, way[-1])
        ax.set_ylim(0.01, 100)
    panels[0].legend(fontsize=8, loc="upper right", ncols=2)
    panels[-1].set_xlabel("way / m; black lines: kidnapped")
    return figure


if __name__ == "__main__":
    sys.exit(main())
