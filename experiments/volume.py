"""The paper's Fig. 5 on a simulated course: volumes of position hypotheses, and what they hold.

`python -m experiments.volume --out DIR [--buildings N] [--first SEED] [--quick]`

A robot drives the course of `course.py` without a camera, and is tracked twice: by APR and wheel
odometry alone, and with the package's default sources. After each cycle the volume V_i of the
strongest hypothesis, centre c_i, radius r_i and angle Δ_i, is held against the true pose in the
frame of its home node. Writes into DIR:

- `volume.png`: V_i in the local configuration space of one node, by APR and odometry, over the
  longest way that the hypothesis went unconfirmed before APR confirmed it again; and over the
  cycles r_i and Δ_i with what the centre is off;
- `claims.png`: the share of cycles in which the truth lies in V_i, over λ_b, in all buildings;
- `hypotheses.csv`: a row for each cycle with a hypothesis. confirmed says whether it was created or
  confirmed in that cycle, unconfirmed_m is the way since; off_m and off_deg are what the centre is
  off the truth;
- `volume.csv`: a row for each choice of sources. inside is the share of cycles with the truth in
  V_i, inside_sure that where λ_b is 0.95 or more, inside_unsure where it is under 0.2, claimed the
  mean λ_b, nearest_outside_m the least that a centre is off where the truth is not in V_i,
  near_misses the cycles in which that is under 1 m. The others are that share, and medians, over
  the cycles in which V_i was confirmed, and over those in which that was at least 2 m ago;
- `configuration.json`.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

import aprjax
from aprjax.configuration import to_dict
from aprjax.metrics import deviations
from aprjax.plane import relative
from aprjax.plot.reliability import draw_reliability
from aprjax.plot.volume import draw_volumes, in_degrees, show_box
from aprjax.tracking.apr import MatchedSource
from aprjax.tracking.belief import Belief
from aprjax.tracking.hypothesis import Hypothesis
from aprjax.tracking.odometry import OdometryConfig, WheelOdometry
from aprjax.tracking.replay import matched
from aprjax.tracking.tracker import TrackerConfig
from aprjax.world.super_space import assemble
from experiments.building import entries_of, parsed
from experiments.course import driven, survey
from experiments.outputs import BLUE, print_table, write_configuration, write_figure, write_table

BUILDINGS = 3
CYCLES = 320  # of the course, with --quick
PAPER = "APR, odometry"  # the choice of sources without validation
SURE, UNSURE = 0.95, 0.2  # λ_b
LONG = 2.0  # metres without a confirmation
NEAR = 1.0  # metres: a centre outside whose volume the truth lies, but at the same place
AROUND = 8  # cycles shown before and after
LETTERS, LARGEST = "abcd", "c"
VOLUME, TRUTH = BLUE, "#000000"


@dataclass(frozen=True)
class Tracked:
    """What is believed on a course, by each choice of sources, and the truth."""

    world: aprjax.WorldModel
    T_world_node: np.ndarray
    """`(nodes, 3)`, as those of the course."""
    T_world_laser: np.ndarray
    beliefs: dict[str, list[Belief]]
    """One after each cycle."""
    confirmed: dict[str, list[bool]]
    """Whether the strongest hypothesis was created or confirmed in the cycle."""

    def truth(self, cycle: int, node: int) -> np.ndarray:
        """The true pose `(3,)` after a cycle, in a node's frame."""
        return relative(self.T_world_node[node], self.T_world_laser[cycle])


@dataclass(frozen=True)
class Growth:
    """A way that the strongest hypothesis went unconfirmed before APR confirmed it: cycles."""

    first: int
    """Confirmed the last time before."""
    again: int
    """Confirmed again."""


def main() -> int:
    """Drive, track, print, write; the exit status."""
    arguments = parsed(__doc__, BUILDINGS, quick="one building, 320 cycles, the paper's sources")
    buildings, cycles = (1, CYCLES) if arguments.quick else (arguments.buildings, None)

    rows: list[dict] = []
    for seed in range(arguments.first, arguments.first + buildings):
        print(f"building {seed}", file=sys.stderr, flush=True)
        told = tracked(seed, cycles, [PAPER] if arguments.quick else [PAPER, "defaults"])
        if seed == arguments.first:
            write_figure(draw_growth(told), arguments.out / "volume.png", dpi=95)
        for name in told.beliefs:
            rows += held(told, name, seed)
        write_table(rows, arguments.out / "hypotheses.csv")  # after each: they take minutes
    summary = [summed(name, chosen) for name, chosen in by_sources(rows).items()]
    print_table(summary)
    write_table(summary, arguments.out / "volume.csv")
    write_figure(draw_claims(by_sources(rows)), arguments.out / "claims.png")
    write_configuration(
        arguments.out,
        first=arguments.first,
        buildings=buildings,
        cycles=cycles,
        tracker=to_dict(TrackerConfig()),
        odometry=to_dict(OdometryConfig()),
    )
    return 0


def tracked(seed: int, cycles: int | None, choices: Sequence[str]) -> Tracked:
    """So many cycles of the course in a building, tracked by some choices of sources."""
    known = survey(seed)
    _, drive = driven(seed, known.built, cycles)
    own: dict[str, dict] = {PAPER: {"tracking": [WheelOdometry()], "validation": []}}
    trackers = {
        name: aprjax.HypothesisTracker(known.world, primary=[MatchedSource()], **own.get(name, {}))
        for name in choices
    }
    beliefs: dict[str, list[Belief]] = {name: [] for name in choices}
    confirmed: dict[str, list[bool]] = {name: [] for name in choices}
    for entry, match in matched(known.world, entries_of(drive)):
        for name, tracker in trackers.items():
            moved = tracker.move(odometry=entry.odometry, scan=entry.scan)
            beliefs[name].append(tracker.observe(match=match, scan=entry.scan))
            confirmed[name].append(is_anew(moved, beliefs[name][-1]))
    return Tracked(known.world, known.T_world_node, drive.T_world_laser, beliefs, confirmed)


def is_anew(moved: Belief, observed: Belief) -> bool:
    """Whether the strongest hypothesis has a volume that motion has not given it."""
    best = observed.best
    carried = {h.number: h.covariance for h in moved.hypotheses}
    return best is not None and not np.array_equal(
        best.covariance, carried.get(best.number, np.empty(0))
    )


def held(told: Tracked, name: str, seed: int) -> list[dict]:
    """Rows of the table: the strongest hypothesis after each cycle, and where the truth is."""
    rows = []
    for cycle, belief in enumerate(told.beliefs[name]):
        best = belief.best
        if best is None:
            continue
        centre = best.place.T_node_laser
        off, turn = deviations(centre, told.truth(cycle, best.place.node))
        rows.append(
            {
                "building": seed,
                "sources": name,
                "cycle": cycle + 1,
                "node": best.place.node,
                "x_m": round(float(centre[0]), 3),
                "y_m": round(float(centre[1]), 3),
                "theta_deg": round(float(np.degrees(centre[2])), 2),
                "radius_m": round(best.radius, 3),
                "angle_deg": round(float(np.degrees(best.angle)), 2),
                "probability": round(best.probability, 4),
                "confirmed": told.confirmed[name][cycle],
                "unconfirmed_m": round(best.unconfirmed, 2),
                "off_m": round(float(off), 3),
                "off_deg": round(float(np.degrees(turn)), 2),
                "inside": bool(off <= best.radius and turn <= best.angle),
            }
        )
    return rows


def by_sources(rows: Sequence[dict]) -> dict[str, dict[str, np.ndarray]]:
    """Columns of the table for each choice of sources."""
    return {
        name: {
            column: np.array([row[column] for row in rows if row["sources"] == name])
            for column in rows[0]
        }
        for name in dict.fromkeys(row["sources"] for row in rows)
    }


def summed(name: str, chosen: dict[str, np.ndarray]) -> dict:
    """A row of the summary."""
    inside, probability, off = (chosen[column] for column in ("inside", "probability", "off_m"))
    row = {
        "sources": name,
        "cycles": len(inside),
        "inside": _share(inside),
        "claimed": round(float(probability.mean()), 3),
        "inside_sure": _share(inside[probability >= SURE]),
        "inside_unsure": _share(inside[probability < UNSURE]),
        "nearest_outside_m": "" if inside.all() else float(off[~inside].min()),
        "near_misses": int(np.sum(~inside & (off < NEAR))),
    }
    for when, mask in (
        ("confirmed", chosen["confirmed"]),
        ("long", chosen["unconfirmed_m"] >= LONG),
    ):
        row[f"{when}_inside"] = _share(inside[mask])
        for column in ("radius_m", "angle_deg", "off_m", "off_deg"):
            values = chosen[column][mask]
            row[f"{when}_{column}"] = round(float(np.median(values)), 2) if mask.any() else ""
    return row


def _share(mask: np.ndarray) -> float | str:
    """The share of true ones; empty if there is nothing to share."""
    return round(float(mask.mean()), 3) if len(mask) else ""


def longest_growth(beliefs: Sequence[Belief], confirmed: Sequence[bool]) -> Growth:
    """The longest way in metres. Raises `ValueError` if no hypothesis was ever confirmed again."""
    best: Growth | None = None
    longest, first = 0.0, 0
    for cycle, (before, now) in enumerate(pairwise(beliefs), 1):
        if not confirmed[cycle] or before.best is None or now.best is None:
            continue
        if before.best.number == now.best.number and before.best.unconfirmed > longest:
            longest, best = before.best.unconfirmed, Growth(first, cycle)
        first = cycle
    if best is None:
        raise ValueError("beliefs: no hypothesis went unconfirmed and was confirmed again")
    return best


def draw_growth(told: Tracked) -> Figure:
    """V_i before, during and after its longest growth, and its size over the cycles."""
    beliefs = told.beliefs[PAPER]
    growth = longest_growth(beliefs, told.confirmed[PAPER])
    chosen = {
        cycle: best
        for cycle in range(growth.first - AROUND, growth.again + AROUND + 1)
        if 0 <= cycle < len(beliefs) and (best := beliefs[cycle].best) is not None
    }
    last = growth.again - 1
    half = min(
        range(growth.first, growth.again),
        key=lambda cycle: abs(chosen[cycle].unconfirmed - chosen[last].unconfirmed / 2),
    )
    shown = {
        growth.first: "confirmed by APR",
        half: f"{chosen[half].unconfirmed:.1f} m by odometry alone",
        last: f"{chosen[last].unconfirmed:.1f} m by odometry alone",
        growth.again: "confirmed again",
    }
    figure = Figure(figsize=(11.5, 6.9), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=[1.9, 1.0])
    volumes, curves = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    node = chosen[growth.first].place.node
    panels = volumes.subplots(2, 2, subplot_kw={"projection": "3d"}).flat
    draw_spaces(told, node, {c: chosen[c] for c in shown}, list(shown.values()), list(panels))
    volumes.suptitle(f"$V_i$ in the local configuration space of node {node}", fontsize=11)
    draw_sizes(told, chosen, list(shown), curves.subplots(2, 1, sharex=True))
    return figure


def draw_spaces(
    told: Tracked,
    node: int,
    chosen: dict[int, Hypothesis],
    titles: Sequence[str],
    panels: Sequence[Axes3D],
) -> None:
    """The strongest hypotheses of some cycles in the node's frame, one a panel."""
    T_node_home = assemble(told.world, node)
    first, last = min(chosen), max(chosen)
    truth = np.array([told.truth(cycle, node) for cycle in range(first, last + 1)])
    middle = float(truth[-1, 2])
    for ax, letter, title, (cycle, hypothesis) in zip(
        panels, LETTERS, titles, chosen.items(), strict=True
    ):
        draw_volumes(
            T_node_home, [hypothesis], middle=middle, colour=VOLUME, named=letter == LARGEST, ax=ax
        )
        way = in_degrees(truth[: cycle - first + 1], middle)
        ax.plot(*way.T, color=TRUTH, lw=1.2, label="true poses since (a)")
        ax.plot(*way[-1:].T, "o", color=TRUTH, ms=3.5)
        radius, angle = f"{hypothesis.radius:.2f} m", f"{np.degrees(hypothesis.angle):.0f}°"
        size = (
            f"$r_i$ = {radius}, $\\Delta_i$ = {angle}, $\\lambda_i$ = {hypothesis.probability:.2f}"
        )
        ax.set_title(f"({letter}) cycle {cycle + 1}: {title}\n{size}", fontsize=9)
    limits = np.array([[ax.get_xlim(), ax.get_ylim(), ax.get_zlim()] for ax in panels])
    for ax in panels:
        show_box(ax, limits[..., 0].min(axis=0), limits[..., 1].max(axis=0))
    panels[0].legend(fontsize=8, loc="upper left", frameon=False)


def draw_sizes(
    told: Tracked, chosen: dict[int, Hypothesis], marked: Sequence[int], panels: Sequence[Axes]
) -> None:
    """r_i and Δ_i over the cycles, beside what the centre is off; the marked ones by letters."""
    centres = np.array([h.place.T_node_laser for h in chosen.values()])
    truth = np.array([told.truth(cycle, h.place.node) for cycle, h in chosen.items()])
    off, turn = deviations(centres, truth)
    sizes = (
        (off, [h.radius for h in chosen.values()], "$r_i$", "m"),
        (np.degrees(turn), np.degrees([h.angle for h in chosen.values()]), "$\\Delta_i$", "°"),
    )
    cycles = np.array(list(chosen)) + 1
    for ax, (error, size, symbol, unit) in zip(panels, sizes, strict=True):
        ax.plot(cycles, size, color=VOLUME, marker=".", label=symbol)
        ax.plot(cycles, error, color=TRUTH, marker=".", label="what the centre is off")
        for letter, cycle in zip(LETTERS, marked, strict=True):
            ax.axvline(cycle + 1, color="#999999", lw=0.8, ls=":")
            # (c) and (d) are successive cycles.
            beside = {"c": "right", "d": "left"}.get(letter, "center")
            at = (cycle + 1, 1.01)
            ax.annotate(f"({letter})", at, xycoords=("data", "axes fraction"), ha=beside)
        ax.set_ylabel(f"{symbol} / {unit}")
        ax.set_ylim(0, 1.2 * max(size))  # room for the legend
        ax.grid(color="#dddddd", linewidth=0.5)
        ax.legend(fontsize=8, loc="upper left", frameon=False)
    panels[-1].set_xlabel("cycle")


def draw_claims(chosen: dict[str, dict[str, np.ndarray]]) -> Figure:
    """How often the truth lies in V_i, over λ_b; a panel for each choice of sources."""
    figure = Figure(figsize=(4.4 * len(chosen), 4.4), layout="constrained")
    panels: Sequence[Axes] = figure.subplots(1, len(chosen), squeeze=False)[0]
    for ax, (name, columns) in zip(panels, chosen.items(), strict=True):
        draw_reliability(columns["probability"], columns["inside"], name, ax=ax)
        ax.set(xlabel="$\\lambda_b$", ylabel="share of cycles with the truth in $V_i$")
    return figure


if __name__ == "__main__":
    sys.exit(main())
