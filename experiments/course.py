"""The paper's test course (4.B) in simulation, with and without the image classifier.

`python -m experiments.course --out DIR [--buildings N] [--first SEED] [--quick]`

In each of five simulated buildings of 50 x 70 m, a mapping run goes once round; 53 of its scans
become references, none of them in the middle of the two long corridors, where all doors are shut
and a scanner that sees 8 m finds nothing to match. A camera's images are sorted into 150 classes by
growing neural gas, and registered in the map. Later, in other light, with other people about and a
quarter of the movable things elsewhere, a robot goes round again, by other ways. A particle filter
(`particle_filter.py`) gets the same scans and odometry, no images, and a grid drawn from the 53
references at their true poses. It always names a pose, so that its search from all over the
building counts.

Prints and writes `course.csv`, a row for each building and choice of sources: the first cycle with
a hypothesis; from there on, the share of cycles in which the strongest hypothesis is the right one
(within 1 m and 20° of the truth: along a plain corridor nothing but wheels measure the way); how
often that is lost, how many of these losses begin in the corridors or up to 5 m after them, and the
metres until it is back, in the mean and at worst; the shares of cycles within 0.5 m and 10°, and
committed (λ_b, or the particles' weight about one place, over 0.5) to another than the right one.

`course.png`: λ_b and λ_0 over the course of the first building. `cycles.png`: the paper's Fig. 7,
the hypotheses after cycles 1, 32, 75 and 106.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.metrics import deviations, is_right
from aprjax.places.classifier import ViewClassifier
from aprjax.places.features import image_features
from aprjax.plane import compose
from aprjax.plot.hypotheses import draw_hypotheses
from aprjax.sim.camera import Camera, take_images
from aprjax.sim.lab import choose_references
from aprjax.sim.laser import Laser
from aprjax.sim.run import Run
from aprjax.sim.textures import Textures
from aprjax.tracking.apr import MatchedSource
from aprjax.tracking.belief import Belief
from aprjax.tracking.classes import image_source, register_images
from aprjax.tracking.odometry import WheelOdometry
from aprjax.tracking.replay import matched
from aprjax.tracking.validation import IdcSource
from aprjax.world.super_space import assemble
from experiments.building import (
    RANGE,
    Building,
    building,
    entries_of,
    lap,
    mapped,
    parsed,
    poses_along,
    recorded,
)
from experiments.outputs import (
    BLUE,
    RED,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)
from experiments.particle_filter import LikelihoodField, ParticleFilter

BUILDINGS, REFERENCES = 5, 53
MAPPING_STEP, STEP = 0.3, 0.28  # metres between scans; the paper's cycles are as far apart
IMAGED = 2  # every second scan of the mapping run has an image
CYCLES = 1, 32, 75, 106
RIGHT, TURNED = 1.0, np.radians(20)
PARTICLES = 2000, 20_000
AFTER = 5.0  # metres after a corridor that still count as caused by it


@dataclass(frozen=True)
class Survey:
    """A building, and the map of a run round it."""

    built: Building
    run: Run
    """The mapping run."""
    world: aprjax.WorldModel
    T_world_node: np.ndarray
    """`(nodes, 3)`, the truth: to score with."""
    T_world_ref: np.ndarray
    """`(references, 3)`, the truth, by ascending number: for the particle filter's grid."""


@dataclass(frozen=True)
class Course:
    """What is recorded on a course, and the map."""

    built: Building
    world: aprjax.WorldModel
    T_world_node: np.ndarray
    """`(nodes, 3)`, the truth, as that of the course: to score with."""
    T_world_ref: np.ndarray
    """`(references, 3)`, the truth, by ascending number: for the particle filter's grid."""
    classifier: ViewClassifier
    entries: list[aprjax.LogEntry]
    images: np.ndarray
    T_world_laser: np.ndarray


def main() -> int:
    """Drive, track, print, write; the exit status."""
    arguments = parsed(__doc__, BUILDINGS, quick="one building, 110 cycles")
    buildings, cycles = (1, 110) if arguments.quick else (arguments.buildings, None)
    particles = PARTICLES[:1] if arguments.quick else PARTICLES

    rows = []
    for seed in range(arguments.first, arguments.first + buildings):
        print(f"building {seed}", file=sys.stderr, flush=True)
        told = course(seed, cycles)
        found = tracked(told)
        answers = {name: strongest(told, run) for name, run in found.items()}
        answers |= {f"{count} particles": filtered(told, count, seed) for count in particles}
        rows += [
            {"building": seed, **scored(told, name, *answer)} for name, answer in answers.items()
        ]
        if seed == 0:
            write_figure(draw_course(told, found), arguments.out / "course.png")
            write_figure(
                draw_cycles(told, found["defaults and images"]), arguments.out / "cycles.png"
            )
        write_table(rows, arguments.out / "course.csv")  # after each: they take minutes
    print_table(rows)
    write_configuration(arguments.out, buildings=buildings)
    return 0


def course(seed: int, cycles: int | None) -> Course:
    """A building, a map with image classes, and so many cycles of a course in it."""
    known = survey(seed)
    built, T_world_laser = known.built, known.run.T_world_laser
    camera, textures = Camera(), Textures.draw(200 + seed, built.plan)
    imaged = np.arange(0, len(T_world_laser), IMAGED)
    images = take_images(300 + seed, camera, built.plan, textures, T_world_laser[imaged])
    classifier = ViewClassifier.train(list(images), image_features, seed)
    register_images(known.world, classifier, dict(zip(imaged.tolist(), images, strict=True)))

    later, drive = driven(seed, built, cycles)
    way = drive.T_world_laser
    images = take_images(700 + seed, camera, later.plan, textures, way)
    return Course(
        built,
        known.world,
        known.T_world_node,
        known.T_world_ref,
        classifier,
        entries_of(drive),
        images,
        way,
    )


def survey(seed: int) -> Survey:
    """A building, and a map whose references leave out the middle of the long corridors."""
    built = building(seed, shut=True)
    way = poses_along(lap(100 + seed, built, visits=3), MAPPING_STEP)
    run = recorded(seed, built, [way], _laser())
    seen = np.flatnonzero(~built.is_blank(run.T_world_laser[:, :2]))
    references = seen[choose_references(run.T_world_laser[seen], REFERENCES)]
    world, T_world_node = mapped(seed, run, entries_of(run), references)
    return Survey(built, run, world, T_world_node, run.T_world_laser[references])


def driven(seed: int, built: Building, cycles: int | None) -> tuple[Building, Run]:
    """The building as it is later, and so many cycles of a course in it, by default all."""
    later = built.later(400 + seed)
    way = poses_along(lap(500 + seed, built, visits=1), STEP)[:cycles]
    return later, recorded(600 + seed, later, [way], _laser())


def _laser() -> Laser:
    return Laser.sick(1.0, range_max=RANGE)


def tracked(told: Course) -> dict[str, list[Belief]]:
    """What is believed after each cycle, with the paper's sources and with the package's."""
    # Sources remember, so that each tracker has its own.
    choices: dict[str, dict] = {
        "APR, odometry, images": {
            "tracking": [WheelOdometry()],
            "validation": [image_source(told.world, told.classifier)],
        },
        "APR, odometry": {"tracking": [WheelOdometry()], "validation": []},
        "defaults and images": {
            "validation": [IdcSource(), image_source(told.world, told.classifier)]
        },
        "defaults": {},
    }
    trackers = {
        name: aprjax.HypothesisTracker(told.world, primary=[MatchedSource()], **sources)
        for name, sources in choices.items()
    }
    found: dict[str, list[Belief]] = {name: [] for name in choices}
    for (entry, match), image in zip(matched(told.world, told.entries), told.images, strict=True):
        for name, tracker in trackers.items():
            tracker.move(odometry=entry.odometry, scan=entry.scan)
            found[name].append(tracker.observe(match=match, scan=entry.scan, image=image))
    return found


def filtered(told: Course, particles: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A particle filter's strongest poses in the world, `(cycles, 3)`, and the weights there."""
    scans = [scan for _, scan in sorted(told.world.reference_scans.items())]
    field = LikelihoodField.of(scans, told.T_world_ref)
    answers = ParticleFilter(field, particles, seed).follow(told.entries)
    poses, weights, _ = (np.array(column) for column in zip(*answers, strict=True))
    return poses, weights


def strongest(told: Course, beliefs: Sequence[Belief]) -> tuple[np.ndarray, np.ndarray]:
    """Where the strongest hypotheses are in the world, `(cycles, 3)`, and their λ.

    NaN and 0 where there is none.
    """
    poses, probability = np.full((len(beliefs), 3), np.nan), np.zeros(len(beliefs))
    for row, belief in enumerate(beliefs):
        if belief.best is not None:
            place = belief.best.place
            poses[row] = compose(told.T_world_node[place.node], place.T_node_laser)
            probability[row] = belief.best.probability
    return poses, probability


def scored(told: Course, name: str, poses: np.ndarray, probability: np.ndarray) -> dict:
    """A row of the table, for strongest poses in the world and how sure they are."""
    truth = told.T_world_laser
    gap, turn = deviations(poses, truth)
    first = int(np.argmax(np.isfinite(gap)))
    is_it = ((gap < RIGHT) & (turn < TURNED))[first:]
    way = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])[first:]
    edges = np.flatnonzero(np.diff(np.concatenate([[1], is_it.astype(int), [1]])))
    losses = edges.reshape(-1, 2)
    back = [way[min(end, len(way) - 1)] - way[start] for start, end in losses]
    blank = told.built.is_blank(truth[:, :2])[first:]
    dark = way[blank]
    caused = [np.any((dark >= way[start] - AFTER) & (dark <= way[start])) for start, _ in losses]
    committed = (probability > 0.5)[first:]
    return {
        "sources": name,
        "cycles": len(poses),
        "in_corridors": int(blank.sum()),
        "first_cycle": first + 1,
        "strongest_is_right": round(float(is_it.mean()), 3),
        "losses": len(losses),
        "by_corridors": int(sum(caused)),
        "back_after_m": round(float(np.mean(back)), 1) if back else 0.0,
        "worst_m": round(float(np.max(back)), 1) if back else 0.0,
        "within_0.5_m": round(float(is_right(poses, truth)[first:].mean()), 3),
        "committed_wrong": round(float((committed & ~is_it).mean()), 4),
    }


def draw_course(told: Course, found: dict[str, list[Belief]]) -> Figure:
    """λ_b and λ_0 over the way, one panel for each choice of sources."""
    truth = told.T_world_laser
    way = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])
    blank = told.built.is_blank(truth[:, :2])
    figure = Figure(figsize=(11, 2.1 * len(found) + 0.6), layout="constrained")
    panels = figure.subplots(len(found), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for ax, (name, beliefs) in zip(panels, found.items(), strict=True):
        poses, best = strongest(told, beliefs)
        gap, turn = deviations(poses, truth)
        wrong = ~((gap < RIGHT) & (turn < TURNED)) & (best > 0)
        ax.fill_between(way, 0, 1, where=blank, color="#e6e2d8", lw=0, label="nothing to match")
        ax.plot(way, best, color=BLUE, lw=1.2, label="$\\lambda_b$, the strongest")
        ax.plot(way, [b.rest for b in beliefs], color="#999999", lw=1.0, label="$\\lambda_0$, rest")
        ax.plot(way[wrong], best[wrong], ".", color=RED, ms=4, label="not the right one")
        ax.set_title(name, fontsize=10, loc="left")
        ax.set_ylim(0, 1.02)
        ax.set_xlim(0, way[-1])
    panels[-1].set_xlabel("way / m")
    panels[0].legend(fontsize=8, loc="center left", ncols=4)
    return figure


def draw_cycles(told: Course, beliefs: Sequence[Belief]) -> Figure:
    """The paper's Fig. 7."""
    figure = Figure(figsize=(15, 18.7))
    figure.set_layout_engine("constrained", h_pad=0.12)  # inches, for the legends below
    frame = assemble(told.world)
    panels = figure.subplots(2, 2).flat
    for ax, cycle in zip(panels, CYCLES, strict=True):
        belief = beliefs[min(cycle, len(beliefs)) - 1]
        draw_hypotheses(told.world, frame, belief, f"after cycle {cycle}", ax=ax)
    return figure


if __name__ == "__main__":
    sys.exit(main())
