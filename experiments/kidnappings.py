"""Kidnapped to random places in simulation, hypotheses beside a particle filter.

`python -m experiments.kidnappings --out DIR [--buildings N] [--first SEED] [--quick]`

In each of five simulated buildings of 50 x 70 m, a mapping run goes once round in either direction;
its scans 1.5 m or 40° apart are the references. Later, with other people about and a quarter of
the movable things elsewhere, a robot is carried to a random place and drives 10 m on errands, then
is carried away again, 40 times; its wheels notice nothing of that. The tracker has its defaults.
The particle filter (`particle_filter.py`) gets the same scans and odometry, and a grid drawn from
the references at their true poses.

Prints and writes `kidnappings.csv`: of the kidnappings, the share after which the robot commits
itself (λ, or the particles' weight about one place, over 0.5) to the right place, within 0.5 m and
10°, within 8 m; the median and worst metres until then, the whole 10 where it does not; of the
steps, the shares committed to the right and to a wrong place; CPU time a step, matching apart.
`kidnappings.png`: how many had recovered after how many metres.
"""

import sys
import time
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.metrics import is_right
from aprjax.plane import compose
from aprjax.sim.laser import Laser
from aprjax.tracking.apr import MatchedSource
from aprjax.tracking.replay import matched
from experiments.building import (
    Building,
    building,
    entries_of,
    errand,
    lap,
    mapped,
    parsed,
    poses_along,
    recorded,
    spaced,
)
from experiments.outputs import print_table, write_configuration, write_figure, write_table
from experiments.particle_filter import LikelihoodField, ParticleFilter

BUILDINGS, KIDNAPPINGS = 5, 40
LENGTH, STEP = 10.0, 0.5  # metres driven after each, and between scans
WITHIN = 8.0  # metres in which the robot should be found again
PARTICLES = 2000, 20_000


@dataclass(frozen=True)
class Outcome:
    """Of one method in one building: `(steps,)` each."""

    right: np.ndarray
    """Whether the strongest pose is."""
    committed: np.ndarray
    seconds: np.ndarray
    """CPU time."""


@dataclass(frozen=True)
class Trial:
    """What is recorded in one building after the mapping run."""

    world: aprjax.WorldModel
    T_world_node: np.ndarray
    """`(nodes, 3)`, the truth, as those of the references and of the drive: to score with."""
    T_world_ref: np.ndarray
    entries: list[aprjax.LogEntry]
    T_world_laser: np.ndarray
    starts: np.ndarray
    """`(kidnappings,)`: the first step after each."""


def main() -> int:
    """Kidnap, track, print, write; the exit status."""
    arguments = parsed(__doc__, BUILDINGS, quick="one building, three kidnappings")
    buildings, kidnappings = (1, 3) if arguments.quick else (arguments.buildings, KIDNAPPINGS)
    particles = PARTICLES[:1] if arguments.quick else PARTICLES

    trials, outcomes, rows = [], {}, []
    for seed in range(arguments.first, arguments.first + buildings):
        print(f"building {seed}", file=sys.stderr, flush=True)
        trials.append(trial(seed, kidnappings))
        outcomes.setdefault("hypotheses", []).append(by_hypotheses(trials[-1]))
        for count in particles:
            name = f"{count} particles"
            outcomes.setdefault(name, []).append(by_particles(trials[-1], count, seed))
        rows = [scored(name, trials, found) for name, found in outcomes.items()]
        write_table(rows, arguments.out / "kidnappings.csv")  # after each: they take minutes
        write_figure(draw(trials, outcomes), arguments.out / "kidnappings.png")
    print_table(rows)
    write_configuration(arguments.out, buildings=buildings, kidnappings=kidnappings)
    return 0


def trial(seed: int, kidnappings: int) -> Trial:
    """A building, a map of it, and a drive with kidnappings."""
    built: Building = building(seed, shut=False)
    laser = Laser.sick(1.0)
    laps = [poses_along(lap(100 + seed, built, 3, clockwise), STEP) for clockwise in (False, True)]
    run = recorded(200 + seed, built, [np.concatenate(laps)], laser)
    references = spaced(run.T_world_laser)
    world, T_world_node = mapped(seed, run, entries_of(run), references)
    pieces = [
        poses_along(errand(1000 * (seed + 1) + k, built, LENGTH), STEP)
        for k in range(kidnappings + 1)
    ]
    pieces = [piece[: int(LENGTH / STEP) + 1] for piece in pieces]
    drive = recorded(300 + seed, built.later(400 + seed), pieces, laser)
    return Trial(
        world,
        T_world_node,
        run.T_world_laser[references],
        entries_of(drive),
        drive.T_world_laser,
        np.cumsum([len(piece) for piece in pieces[:-1]]),
    )


def by_hypotheses(told: Trial) -> Outcome:
    """The tracker with its default sources."""
    tracker = aprjax.HypothesisTracker(told.world, primary=[MatchedSource()])
    poses, committed, seconds = [], [], []
    for entry, match in matched(told.world, told.entries):
        began = time.process_time()
        tracker.move(odometry=entry.odometry, scan=entry.scan)
        best = tracker.observe(match=match, scan=entry.scan).best
        seconds.append(time.process_time() - began)
        committed.append(best is not None and best.probability > 0.5)
        node = None if best is None else told.T_world_node[best.place.node]
        poses.append(
            np.full(3, np.nan)
            if best is None or node is None
            else compose(node, best.place.T_node_laser)
        )
    right = is_right(np.array(poses), told.T_world_laser)
    return Outcome(right, np.array(committed), np.array(seconds))


def by_particles(told: Trial, particles: int, seed: int) -> Outcome:
    """The particle filter."""
    scans = [scan for _, scan in sorted(told.world.reference_scans.items())]
    field = LikelihoodField.of(scans, told.T_world_ref)
    answers = ParticleFilter(field, particles, seed).follow(told.entries)
    poses, weights, seconds = (np.array(column) for column in zip(*answers, strict=True))
    return Outcome(is_right(poses, told.T_world_laser), weights > 0.5, seconds)


def recoveries(told: Trial, found: Outcome) -> np.ndarray:
    """Metres driven after each kidnapping until committed and right; infinite if never."""
    way = np.concatenate([[0], np.hypot(*np.diff(told.T_world_laser[:, :2], axis=0).T)])
    way[told.starts] = 0.0
    metres = []
    for start, end in zip(told.starts, [*told.starts[1:], len(way)], strict=True):
        good = np.flatnonzero((found.right & found.committed)[start:end])
        metres.append(way[start : start + good[0] + 1].sum() if len(good) else np.inf)
    return np.array(metres)


def scored(name: str, trials: list[Trial], found: list[Outcome]) -> dict:
    """A row of the table."""
    metres = np.concatenate([recoveries(t, f) for t, f in zip(trials, found, strict=True)])
    right, committed, seconds = (
        np.concatenate([getattr(each, field) for each in found])
        for field in ("right", "committed", "seconds")
    )
    references = np.mean([len(told.world.appearances) for told in trials])
    return {
        "method": name,
        "references": round(float(references)),
        "kidnappings": len(metres),
        "recovered_8_m": round(float(np.mean(metres <= WITHIN)), 3),
        "recovered": round(float(np.mean(np.isfinite(metres))), 3),
        "median_m": round(float(np.median(np.minimum(metres, LENGTH))), 2),
        "worst_m": round(float(np.max(np.minimum(metres, LENGTH))), 2),
        "committed_right": round(float(np.mean(right & committed)), 3),
        "committed_wrong": round(float(np.mean(~right & committed)), 4),
        "cpu_ms": round(1e3 * float(np.median(seconds)), 1),
    }


def draw(trials: list[Trial], outcomes: dict[str, list[Outcome]]) -> Figure:
    """Shares of the kidnappings that had recovered, over metres."""
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    ax = figure.add_subplot()
    for name, found in outcomes.items():
        metres = np.concatenate([recoveries(t, f) for t, f in zip(trials, found, strict=True)])
        at = np.linspace(0, LENGTH, 201)
        ax.step(at, np.mean(metres[:, None] <= at, axis=0), where="post", label=name)
    ax.axvline(WITHIN, color="#999999", linewidth=0.8, linestyle="--")
    ax.set_xlabel("way after the kidnapping / m")
    ax.set_ylabel("share committed to the right place once")
    ax.set_ylim(0, 1.02)
    ax.set_xlim(0, LENGTH)
    ax.grid(color="#dddddd", linewidth=0.5)
    ax.legend(frameon=False, loc="lower right")
    return figure


if __name__ == "__main__":
    sys.exit(main())
