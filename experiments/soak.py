"""The tracker for a simulated day, with sources that fail at random.

    python -m experiments.soak --out DIR [--quick] [--hours H] [--seed N]

A robot drives round a ring of nodes at 0.5 m/s, one step a second, and is carried away unseen once
an hour. Its wheels, a global localization technique and a validation source are simulated: noisy,
sometimes wrong, and each now and then out of order for a while, when it raises errors, is silent,
or answers nonsense; stamps come late or from a clock set anew. Every hour the tracker is saved as
JSON and a new one goes on from there. Prints and writes `soak.csv` (ten simulated minutes a row),
and writes `soak.png` and `configuration.json` into DIR. The exit status is 1 unless the λ sum to
one within 1e-9 and lie in [0, 1] throughout, and memory and the time of a step in the last quarter
are those of the second (memory within 5 MiB, time by half). `--quick` is one simulated hour,
without the last two.
"""

import argparse
import gc
import json
import logging
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from aprjax.plane import compose, distance, relative
from aprjax.scan import Scan
from aprjax.tracking.belief import Belief, Situation
from aprjax.tracking.hypothesis import Step
from aprjax.tracking.odometry import WheelOdometry
from aprjax.tracking.sources import Estimate, Remembers, Verdict
from aprjax.tracking.tracker import HypothesisTracker
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place
from experiments.outputs import (
    BLUE,
    DARK,
    RED,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

NODES, SPACING = 24, 4.0  # metres along the ring
LAP, CORNER = NODES * SPACING, 2 * math.pi / NODES
SPEED = 0.5  # metres of a step, a second long
HOUR, PIECE = 3600, 600  # steps; those of a row of the table
RIGHT = 0.5  # metres
FAILURES = ("raises", "silent", "nonsense")
BETWEEN, LASTING = 600.0, 60.0  # mean steps from one failure of a source to the next, and of one
LEAST_SUM_ERROR, MORE_MEMORY, MORE_TIME = 1e-9, 5.0, 1.5
NOWHERE = np.array([1e300, 0.0, np.inf])


def ring() -> WorldModel:
    """A regular polygon of nodes, each with a reference at its origin."""
    world = WorldModel()
    covariance = np.diag([4e-4, 4e-4, 1e-4])
    for node in range(NODES):
        world.add_node(node)
    for node in range(NODES):
        T = np.array([SPACING, 0.0, CORNER])
        world.add_arc(Arc(node, (node + 1) % NODES, T, covariance, "driven"))
    scan = Scan.make(np.ones(5), angle_min=-1.0, angle_increment=0.5, range_max=8.0)
    seen = [Appearance(Place(node, np.zeros(3)), node) for node in range(NODES)]
    world.add_references([scan] * NODES, seen)
    return world


def place_at(way: float) -> Place:
    """Where the robot is after `way` metres."""
    return Place(int(way // SPACING) % NODES, np.array([way % SPACING, 0.0, 0.0]))


def world_pose(place: Place) -> np.ndarray:
    """`(3,)`: a place in a frame of the ring's middle."""
    radius = SPACING / (2 * math.sin(CORNER / 2))
    angle = CORNER * place.node
    heading = angle + (math.pi + CORNER) / 2
    corner = np.array([radius * math.cos(angle), radius * math.sin(angle), heading])
    return compose(corner, place.T_node_laser)


class Failing:
    """A source that is out of order now and then; `mode` says how."""

    def __init__(self, source: Any, rng: np.random.Generator) -> None:
        self.source, self.rng, self.mode = source, rng, ""
        self.reads = source.reads

    def tick(self) -> bool:
        """Whether it is silent for this step."""
        if self.mode and self.rng.random() < 1 / LASTING:
            self.mode = ""
        elif not self.mode and self.rng.random() < 1 / BETWEEN:
            self.mode = str(self.rng.choice(FAILURES))
        return self.mode == "silent"

    def step(self, reading: Any, expected: Any) -> Any:
        return self._answer(lambda: self.source.step(reading, expected))

    def locate(self, reading: Any, world: WorldModel) -> Any:
        return self._answer(lambda: self.source.locate(reading, world))

    def judge(self, reading: Any, hypotheses: Any, world: WorldModel) -> Any:
        return self._answer(lambda: self.source.judge(reading, hypotheses, world))

    def state(self) -> Any:
        """That of the source; the tracker asks by the presence of this method."""
        return self.source.state() if isinstance(self.source, Remembers) else None

    def restore(self, state: Any) -> None:
        """Go on from what `state` returned."""
        if isinstance(self.source, Remembers):
            self.source.restore(state)

    def _answer(self, ask: Any) -> Any:
        if self.mode == "raises":
            raise OSError("the device does not answer")
        if self.mode == "nonsense":
            wrong = Estimate(Place(10**6, NOWHERE), np.full((3, 3), np.nan), math.nan)
            leap = Step(NOWHERE, np.eye(3))
            nonsense = (None, [], 3, [wrong], [Verdict(math.nan)], "?", [None], leap)
            return nonsense[self.rng.integers(len(nonsense))]
        return ask()


class Recognition:
    """A primary source whose reading is the true place: mostly right, to centimetres."""

    reads = "recognition"

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def locate(self, reading: Place, world: WorldModel) -> list[Estimate]:
        rng, found = self.rng, []
        if rng.random() < 0.6:
            T = reading.T_node_laser + rng.normal(0, [0.05, 0.05, 0.01])
            place = Place(reading.node, T)
            found.append(Estimate(place, 1e-3 * np.eye(3), rng.uniform(0.5, 1.0), reading.node))
        if rng.random() < 0.3:
            node = int(rng.integers(NODES))
            place = Place(node, np.array([rng.uniform(0, SPACING), 0.0, 0.0]))
            found.append(Estimate(place, 1e-3 * np.eye(3), rng.uniform(0.0, 0.9), node))
        return found


class Judge:
    """A validation source whose reading is the true place."""

    reads = "judgement"

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def judge(self, reading: Place, hypotheses: Any, world: WorldModel) -> list[Verdict]:
        def near(place: Place) -> bool:
            return bool(distance(world_pose(place) - world_pose(reading)) < RIGHT)

        low, high = (0.8, 3.0), (0.3, 1.2)
        return [Verdict(self.rng.uniform(*(low if near(h.place) else high))) for h in hypotheses]


@dataclass
class Row:
    """Ten simulated minutes."""

    hours: float
    memory_mib: float
    step_ms: float
    """Median time of the processor."""
    step_ms_99: float
    sum_error: float
    """The largest |Σλ - 1|."""
    hypotheses: float
    right: float
    """Share of the steps in which the tracker is sure, and right."""
    wrong: float


def memory() -> float:
    """MiB that the process holds now."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


def sources(rng: np.random.Generator) -> tuple[Failing, Failing, Failing]:
    """Wheels, recognition and validation."""
    return (
        Failing(WheelOdometry(), rng),
        Failing(Recognition(rng), rng),
        Failing(Judge(rng), rng),
    )


def make_tracker(world: WorldModel, wheels: Failing, seen: Failing, judge: Failing):
    """A tracker of these sources."""
    return HypothesisTracker(world, primary=[seen], tracking=[wheels], validation=[judge])


def stamp_at(step: int, clock: float, rng: np.random.Generator) -> float:
    """Seconds, now and then late or not a number."""
    strange = rng.random()
    if strange < 0.002:
        return math.nan
    return clock + step - (rng.uniform(0, 5) if strange < 0.01 else 0.0)


def soak(steps: int, seed: int) -> list[Row]:
    """The rows of so many steps."""
    rng, world = np.random.default_rng(seed), ring()
    made = sources(rng)
    tracker = make_tracker(world, *made)
    way, clock, odometry = 0.0, 0.0, np.zeros(3)
    rows, times, errors, found, counts = [], [], [], [], []
    for step in range(1, steps + 1):
        before = world_pose(place_at(way))
        way = (way + SPEED) % LAP
        now = world_pose(place_at(way))
        T = relative(before, now)
        odometry = compose(odometry, T * rng.normal(1.0, 0.02, 3) + rng.normal(0, 1e-3, 3))
        if rng.random() < 1 / HOUR:
            way = rng.uniform(0, LAP)  # carried away, without a turn of the wheels
        if rng.random() < 1 / HOUR:
            clock -= 1000.0
        truth = place_at(way)
        readings = {"odometry": odometry, "recognition": truth, "judgement": truth}
        readings = {s.reads: readings[s.reads] for s in made if not s.tick()}
        stamp = stamp_at(step, clock, rng)

        began = time.thread_time()
        tracker.move(stamp, **readings)
        belief = tracker.observe(stamp, **readings)
        times.append(1e3 * (time.thread_time() - began))

        errors.append(sum_error(belief))
        found.append(verdict(belief, truth))
        counts.append(len(belief.hypotheses))
        if step % HOUR == 0:
            saved = json.dumps(tracker.state())
            tracker = make_tracker(world, *made)
            tracker.restore(json.loads(saved))
        if step % PIECE == 0:
            rows.append(
                Row(
                    hours=step / HOUR,
                    memory_mib=memory(),
                    step_ms=float(np.median(times)),
                    step_ms_99=float(np.percentile(times, 99)),
                    sum_error=max(errors),
                    hypotheses=float(np.mean(counts)),
                    right=float(np.mean([each == "right" for each in found])),
                    wrong=float(np.mean([each == "wrong" for each in found])),
                )
            )
            for each in (times, errors, found, counts):
                each.clear()
    return rows


def sum_error(belief: Belief) -> float:
    """|Σλ - 1|; infinite if a λ is no probability."""
    shares = [*(hypothesis.probability for hypothesis in belief.hypotheses), belief.rest]
    return abs(math.fsum(shares) - 1) if all(0 <= share <= 1 for share in shares) else math.inf


def verdict(belief: Belief, truth: Place) -> str:
    """What a sure answer is: right or wrong."""
    if belief.situation is not Situation.TRACKING or belief.best is None:
        return ""
    away = distance(world_pose(belief.best.place) - world_pose(truth))
    return "right" if away < RIGHT else "wrong"


def failures(rows: list[Row], whole: bool) -> list[str]:
    """What is not as it should be; of memory and time only in a whole run."""
    said = []
    worst = float(np.max([row.sum_error for row in rows]))
    if not worst <= LEAST_SUM_ERROR:
        said.append(f"the λ sum to one but for {worst}")
    if whole:
        quarters = np.array_split(np.arange(len(rows)), 4)
        then, last = ([rows[i] for i in quarters[q]] for q in (1, 3))
        more = _mean(last, "memory_mib") - _mean(then, "memory_mib")
        if more > MORE_MEMORY:
            said.append(f"memory grew by {more:.1f} MiB")
        slower = _mean(last, "step_ms") / _mean(then, "step_ms")
        if slower > MORE_TIME:
            said.append(f"steps take {slower:.2f} times as long")
    return said


def _mean(rows: list[Row], name: str) -> float:
    return float(np.mean([getattr(row, name) for row in rows]))


def draw(rows: list[Row]) -> Figure:
    """The curves over the hours."""
    figure = Figure(figsize=(9, 8), layout="constrained")
    axes = figure.subplots(4, 1, sharex=True)
    hours = [row.hours for row in rows]

    def curve(ax, name: str, label: str, colour: str) -> None:
        ax.plot(hours, [getattr(row, name) for row in rows], color=colour, lw=1.2, label=label)

    curve(axes[0], "memory_mib", "memory of the process", DARK)
    axes[0].set_ylabel("MiB")
    curve(axes[1], "step_ms", "median", BLUE)
    curve(axes[1], "step_ms_99", "99 of 100 steps are shorter", "#e0b070")
    axes[1].set_ylabel("step / ms")
    axes[2].plot(hours, [max(row.sum_error, 1e-18) for row in rows], color=DARK, lw=1.2)
    axes[2].axhline(LEAST_SUM_ERROR, color=RED, lw=0.8, ls="--", label="allowed")
    axes[2].set_yscale("log")
    axes[2].set_ylabel("largest |Σλ - 1|")
    curve(axes[3], "right", "sure and right", "#2a8a3e")
    curve(axes[3], "wrong", "sure and wrong", RED)
    axes[3].set_ylabel("share of the steps")
    axes[3].set_xlabel("simulated hours")
    axes[0].set_ylim(0, 1.15 * max(row.memory_mib for row in rows))
    for ax in axes:
        ax.grid(color="#dddddd", linewidth=0.5)
        if ax.get_legend_handles_labels()[1]:
            ax.legend(fontsize=8, loc="center right", frameon=False)
    for ax in (axes[1], axes[3]):
        ax.set_ylim(bottom=0)
    return figure


def main() -> int:
    """Run all; the exit status says whether all was as it should be."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--hours", type=int, default=24, metavar="H")
    parser.add_argument("--quick", action="store_true", help="one simulated hour")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    logging.getLogger("aprjax").setLevel(logging.ERROR)
    hours = 1 if arguments.quick else arguments.hours
    write_configuration(arguments.out, hours=hours, seed=arguments.seed)
    rows = soak(HOUR * hours, arguments.seed)
    table = [
        {name: f"{value:.4g}" for name, value in vars(row).items()}
        for row in rows
    ]  # fmt: skip
    write_table(table, arguments.out / "soak.csv")
    write_figure(draw(rows), arguments.out / "soak.png")
    print_table(table if arguments.quick else table[5::6])
    said = failures(rows, whole=not arguments.quick)
    for line in said:
        print(line, file=sys.stderr)
    return int(bool(said))


if __name__ == "__main__":
    sys.exit(main())
