"""How far recognition stands noise, dropouts, changes, narrow views, distance and sparse beams.

    python -m experiments.robustness --out DIR [--quick] [--jobs NAME ...]

One curve a job, over queries in simulated offices: the share whose best hypothesis is right, the
share of those that `match` calls confident as well, and the share of confident wrong ones. All
floors' references are in one set, chosen far apart from a drive. But for what a curve varies, a
query is taken in the unchanged floor within 1 m and 30° of a reference, by a SICK at 1°; sensors
that vary took the references too. Writes a picture a job, `robustness.csv` and
`configuration.json` into DIR.

With --quick there are fewer floors, queries and points: none needs more than 181 beams, so that
the matcher compiles once. The wider views and the finer resolutions are left out.
"""

import argparse
import dataclasses
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

import aprjax
from aprjax.anchors.candidates import Kind
from aprjax.configuration import to_dict
from aprjax.metrics import is_right, world_poses
from aprjax.numerics import bucket
from aprjax.plane import wrap
from aprjax.plot.style import KINDS, add_legend
from aprjax.sim.drive import drive
from aprjax.sim.floor_plan import FloorPlan, office
from aprjax.sim.lab import PERIOD, SCANS, choose_references
from aprjax.sim.laser import Laser, take_scans
from aprjax.sim.people import KEPT_OFF
from aprjax.sim.ray_casting import cast
from aprjax.sim.world import World
from experiments.outputs import write_configuration, write_figure, write_table

FLOORS = (0, 1, 2)  # seeds
REFERENCES = 10  # of each floor
QUERIES = 64  # of each floor and point of a curve
NEAR, TURNED = 1.0, np.radians(30)  # metres and radians between a query and its reference
PEOPLE = 16  # at most, around a query
ALIKE = np.radians(60)  # references that look less alike do not serve the same queries
FLOORS_APART = 100.0  # metres, so that poses of different floors differ

CURVES = {
    "top1": ("best hypothesis right", KINDS[Kind.ANGLE][2]),
    "confident_right": ("right and confident", KINDS[Kind.VIRTUAL_EDGE][2]),
    "confident_wrong": ("wrong and confident", KINDS[Kind.JUMP_EDGE][2]),
}
"""Column, name and colour."""


@dataclass(frozen=True)
class Floor:
    """A floor at the time of its references, with the poses `(N, 3)` that all jobs use."""

    seed: int
    plan: FloorPlan
    references: np.ndarray
    queries: np.ndarray


@dataclass(frozen=True)
class Sample:
    """Queries of all floors at one point of a curve; poses are those of `Floor`s, apart."""

    scans: aprjax.Scan
    poses: np.ndarray


def floor(seed: int, queries: int) -> Floor:
    """The floor of a seed."""
    plan = office(seed)
    way, _ = drive(seed, plan, SCANS, PERIOD)
    references = way[choose_references(way, REFERENCES, distance=4.0)]
    return Floor(seed, plan, references, near(seed, plan, references, queries, 0.0, NEAR))


_sees = jax.jit(jax.vmap(cast, (None, 0, 0)))


def near(
    seed: int, plan: FloorPlan, references: np.ndarray, count: int, low: float, high: float
) -> np.ndarray:
    """Up to `count` poses `(N, 3)` that are `low` to `high` metres from the nearest reference.

    A pose is one that the robot may take, and no surface stands between it and the reference. It
    looks within 30° of the reference's way; references that look elsewhere do not count as near.
    """
    rng = np.random.default_rng([seed, round(1000 * low)])
    tries = 4096
    chosen = references[rng.integers(len(references), size=tries)]
    distance, bearing = rng.uniform(low, high, tries), rng.uniform(-np.pi, np.pi, tries)
    direction = chosen[:, 2] + bearing
    xy = chosen[:, :2] + distance[:, None] * np.stack([np.cos(direction), np.sin(direction)], -1)
    poses = np.concatenate([xy, chosen[:, 2:] + rng.uniform(-TURNED, TURNED, (tries, 1))], axis=1)

    rectangles = np.array([area["rectangle"] for _, area in plan.areas.nodes(data=True)])
    inside = np.all((xy[:, None] > rectangles[:, 0]) & (xy[:, None] < rectangles[:, 1]), axis=2)
    world = padded(plan.world())
    seen = np.asarray(_sees(world, np.float32(chosen), np.float32(bearing[:, None])))[:, 0]
    gap = np.hypot(*np.moveaxis(xy[:, None] - references[:, :2], -1, 0))
    alike = np.abs(wrap(poses[:, None, 2] - references[:, 2])) < ALIKE
    nearest = np.min(np.where(alike, gap, np.inf), axis=1)
    good = inside.any(axis=1) & (seen > distance) & (nearest >= low)
    return poses[good][:count]


def padded(world: World) -> World:
    """The world in a shape that floors share, so that their scans compile once."""
    return world.pad(
        bucket(len(world.segments), smallest=1280), bucket(len(world.circles), smallest=256)
    )


# Scans and scores


def taken(laser: Laser, floors: list[Floor], poses: list[np.ndarray]) -> Sample:
    """Scans from `poses` of each floor, none of it changed."""
    scans = [
        scans_of(floor, laser, floor.plan.world(), here)
        for floor, here in zip(floors, poses, strict=True)
    ]
    return Sample(joined(scans), np.concatenate(apart(poses)))


def scans_of(
    floor: Floor, laser: Laser, world: World, poses: np.ndarray, legs: np.ndarray | None = None
) -> aprjax.Scan:
    """Scans of a floor's `world`, by default without people."""
    legs = np.zeros((len(poses), 2 * PEOPLE, 3)) if legs is None else legs
    return take_scans(jax.random.key(floor.seed), laser, padded(world), legs, poses)


def joined(scans: list[aprjax.Scan]) -> aprjax.Scan:
    """One stack of several."""
    return jax.tree.map(lambda *parts: np.concatenate(parts), *scans)


def apart(poses: list[np.ndarray]) -> list[np.ndarray]:
    """Poses of each floor, in a frame that all floors share."""
    return [here + np.array([FLOORS_APART * i, 0, 0]) for i, here in enumerate(poses)]


def referenced(
    laser: Laser, floors: list[Floor], slots: int
) -> tuple[aprjax.ReferenceSet, np.ndarray]:
    """The set of all floors' references, and their poses."""
    sample = taken(laser, floors, [floor.references for floor in floors])
    return aprjax.ReferenceSet.build(sample.scans.pad(slots)), sample.poses


def scored(
    references: aprjax.ReferenceSet, T_world_ref: np.ndarray, sample: Sample, size: int
) -> dict[str, float]:
    """One point of each curve. Queries are padded to `size`: one shape serves all points."""
    slots = references.scans.ranges.shape[-1]
    count = len(sample.poses)
    result = aprjax.match_batch(sample.scans.pad(slots).pad_batch(size), references)
    result = jax.tree.map(lambda array: array[:count], result)
    best = world_poses(result, references.ids, T_world_ref)[:, 0]
    right = result.valid[:, 0] & is_right(best, sample.poses)
    return {
        "queries": count,
        "top1": float(np.mean(right)),
        "confident_right": float(np.mean(result.confident & right)),
        "confident_wrong": float(np.mean(result.confident & ~right)),
    }


# Jobs: each gives the points of its curve


def by_laser(floors: list[Floor], lasers: dict[float, Laser]) -> Iterator[dict]:
    """A point for each laser, which takes references and queries alike."""
    size = sum(len(floor.queries) for floor in floors)
    slots = bucket(max(laser.beams for laser in lasers.values()))
    for value, laser in lasers.items():
        references = referenced(laser, floors, slots)
        sample = taken(laser, floors, [floor.queries for floor in floors])
        yield {"value": value, **scored(*references, sample, size)}


def noise(floors: list[Floor], quick: bool) -> Iterator[dict]:
    """Metres: standard deviation of every range, beside the SICK's other errors."""
    sigmas = (0.0, 0.03, 0.1) if quick else (0.0, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1)
    lasers = {sigma: Laser.sick(noise=sigma, noise_per_metre=0.0) for sigma in sigmas}
    return by_laser(floors, lasers)


def dropouts(floors: list[Floor], quick: bool) -> Iterator[dict]:
    """Share of the beams that are invalid, each by itself."""
    shares = (0.0, 0.2, 0.5) if quick else (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
    return by_laser(floors, {share: Laser.sick(dropout=share) for share in shares})


def view(floors: list[Floor], quick: bool) -> Iterator[dict]:
    """Degrees of the field of view, at 1°."""
    lasers = {
        float(fov): Laser(beams=fov + 1, angle_min=-np.radians(fov / 2))
        for fov in ((90, 180) if quick else (90, 120, 150, 180, 225, 270, 315))
    }
    if not quick:
        lasers[360.0] = Laser.full_turn()
    return by_laser(floors, lasers)


def resolution(floors: list[Floor], quick: bool) -> Iterator[dict]:
    """Degrees between beams, over a half turn."""
    steps = (1.0, 2.0) if quick else (0.25, 0.5, 1.0, 1.5, 2.0)
    lasers = {
        step: Laser(beams=round(180 / step) + 1, angle_increment=np.radians(step)) for step in steps
    }
    return by_laser(floors, lasers)


def distance(floors: list[Floor], quick: bool) -> Iterator[dict]:
    """Metres from a query to the nearest reference: middles of half metres."""
    laser = Laser.sick()
    size = sum(len(floor.queries) for floor in floors)
    references = referenced(laser, floors, bucket(laser.beams))
    for low in (0.0, 1.5, 3.0) if quick else np.arange(0, 4, 0.5):
        poses = [
            near(floor.seed, floor.plan, floor.references, len(floor.queries), low, low + 0.5)
            for floor in floors
        ]
        yield {"value": low + 0.25, **scored(*references, taken(laser, floors, poses), size)}


def changes(floors: list[Floor], quick: bool) -> Iterator[dict]:
    """Share of a query's beams that people, doors or furniture change: means of tenths.

    Nothing is changed at 0. Else doors and furniture stand elsewhere, and people stand around.
    """
    laser = Laser.sick()
    size = sum(len(floor.queries) for floor in floors)
    references = referenced(laser, floors, bucket(laser.beams))
    still = taken(laser, floors, [floor.queries for floor in floors])
    yield {"value": 0.0, **scored(*references, still, size)}

    pools = [changed(laser, floor) for floor in floors]
    for low in (0.1, 0.4) if quick else (0.0, 0.1, 0.2, 0.3, 0.4):
        chosen = [
            np.flatnonzero((share > low) & (share <= low + 0.1))[: len(floor.queries)]
            for floor, (_, _, share) in zip(floors, pools, strict=True)
        ]
        picked = list(zip(pools, chosen, strict=True))
        scans = [jax.tree.map(lambda a: a[rows], pool[0]) for pool, rows in picked]  # noqa: B023
        poses = apart([pool[1][rows] for pool, rows in picked])
        share = np.concatenate([pool[2][rows] for pool, rows in picked]).mean()
        sample = Sample(joined(scans), np.concatenate(poses))
        yield {"value": round(float(share), 3), **scored(*references, sample, size)}


def changed(laser: Laser, floor: Floor) -> tuple[aprjax.Scan, np.ndarray, np.ndarray]:
    """Scans of a floor that changed, more and less; their poses and shares of changed beams.

    In random order. A beam is changed if its true range is 0.2 m off what it was.
    """
    exact = dataclasses.replace(
        laser, bias=0.0, noise=0.0, noise_per_metre=0.0, dropout=0.0, mixed=0.0
    )
    rng = np.random.default_rng(floor.seed)
    before = scans_of(floor, exact, floor.plan.world(), floor.queries).ranges
    scans, shares = [], []
    for moved in (0.25, 0.5, 0.75, 1.0):
        for most in (0, PEOPLE // 4, PEOPLE // 2, PEOPLE):
            world = floor.plan.rearranged(int(rng.integers(2**31)), moved).world()
            alone = scans_of(floor, exact, world, floor.queries)
            legs = standing_people(rng, alone, floor.queries, most)
            after = scans_of(floor, exact, world, floor.queries, legs).ranges
            with np.errstate(invalid="ignore"):  # both infinite
                shares.append(np.mean(~(np.abs(after - before) <= 0.2) & (after != before), axis=1))
            scans.append(scans_of(floor, laser, world, floor.queries, legs))
    order = rng.permutation(len(scans) * len(floor.queries))
    return (
        jax.tree.map(lambda array: array[order], joined(scans)),
        np.tile(floor.queries, (len(scans), 1))[order],
        np.concatenate(shares)[order],
    )


def standing_people(
    rng: np.random.Generator, scans: aprjax.Scan, poses: np.ndarray, most: int
) -> np.ndarray:
    """Legs `(N, 2 PEOPLE, 3)` of up to `most` people before the surfaces of each scan.

    They stand within 4 m; those who are not there have legs of radius 0.
    """
    shape = len(poses), PEOPLE
    ranges = np.asarray(scans.ranges, float)
    beam = rng.integers(ranges.shape[1], size=shape)
    free = np.minimum(np.take_along_axis(ranges, beam, axis=1) - 0.2, 4.0)
    nearest = KEPT_OFF + 0.2
    off = rng.uniform(nearest, np.maximum(free, nearest))
    there = (free > nearest) & (np.arange(PEOPLE) < rng.integers(most + 1, size=(len(poses), 1)))
    angle = poses[:, 2:] + np.take_along_axis(np.asarray(scans.bearings), beam, axis=1)
    body = poses[:, None, :2] + off[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    facing = rng.uniform(-np.pi, np.pi, shape)
    aside = 0.09 * np.stack([np.cos(facing), np.sin(facing)], -1)
    radius = (rng.uniform(0.05, 0.075, shape) * there)[..., None]
    legs = [np.concatenate([body + side * aside, radius], axis=-1) for side in (-1, 1)]
    return np.concatenate(legs, axis=1)


JOBS = {
    "noise": (noise, "standard deviation of the ranges / m"),
    "dropouts": (dropouts, "share of invalid beams"),
    "changes": (changes, "share of the query's beams that people and furniture change"),
    "view": (view, "field of view / °"),
    "distance": (distance, "distance to the nearest reference / m"),
    "resolution": (resolution, "angle between beams / °"),
}


# Output


def draw(points: list[dict], label: str) -> Figure:
    """The three curves of a job, each with its 95 % interval (Wilson's)."""
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    ax = figure.add_subplot()
    value = np.array([point["value"] for point in points])
    count = np.array([point["queries"] for point in points])
    for column, (name, colour) in CURVES.items():
        share = np.array([point[column] for point in points])
        middle = (share + 1.92 / count) / (1 + 3.84 / count)
        half = 1.96 * np.sqrt(share * (1 - share) / count + 0.96 / count**2) / (1 + 3.84 / count)
        ax.fill_between(value, middle - half, middle + half, color=colour, alpha=0.15, lw=0)
        ax.plot(value, share, color=colour, marker="o", markersize=4, label=name)
    ax.set_ylim(-0.03, 1.03)
    ax.set_xlabel(label)
    ax.set_ylabel("share of the queries")
    ax.grid(color="#dddddd", linewidth=0.5)
    ax.set_axisbelow(True)
    add_legend(ax)
    return figure


def main() -> int:
    """Measure, print and draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="few points and queries")
    parser.add_argument("--jobs", nargs="+", choices=JOBS, default=list(JOBS), metavar="NAME")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)

    seeds, queries = (FLOORS[:2], 16) if arguments.quick else (FLOORS, QUERIES)
    floors = [floor(seed, queries) for seed in seeds]
    rows = []
    print(f"{'job':10s}  value  queries  right  confident: right  wrong")
    for name in arguments.jobs:
        job, label = JOBS[name]
        points = []
        for point in job(floors, arguments.quick):
            points.append(point)
            print(
                "{job:10s} {value:6.3f}  {queries:7d}  {top1:.3f}            "
                "{confident_right:.3f}  {confident_wrong:.3f}".format(job=name, **point),
                flush=True,
            )
        rows += [{"job": name, **point} for point in points]
        write_figure(draw(points, label), arguments.out / f"{name}.png", dpi=150)
    write_table(rows, arguments.out / "robustness.csv")
    write_configuration(
        arguments.out,
        floors=seeds,
        references_per_floor=REFERENCES,
        queries_per_floor=queries,
        laser=to_dict(Laser.sick()),
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
