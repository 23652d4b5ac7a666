"""`aprjax demo`: the paper's experiment (2.E, Fig. 3) in a simulated lab, end to end."""

import argparse
import csv
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
from matplotlib.artist import Artist

from aprjax.atomic import atomic_write
from aprjax.batch import match
from aprjax.cli.lab import add_lab_options, build_lab
from aprjax.cli.outputs import make_folder
from aprjax.cli.progress import Progress
from aprjax.matcher import MatchConfig
from aprjax.metrics import RIGHT_ANGLE, RIGHT_DISTANCE, is_right, world_poses
from aprjax.plot.map import draw_map
from aprjax.plot.match import draw_match
from aprjax.plot.style import figure_of
from aprjax.references import ReferenceSet
from aprjax.result import MatchResult
from aprjax.scan import Scan
from aprjax.sim.lab import Lab

_COLUMNS = (("top 1", 1), ("top 5", 5), ("all references", None))
_ROWS = ("correct", "false", "none", "mean time per scan", "maximum time per scan")
_PAPER = (
    ("374", "0", "1031", "not stated", "not stated"),
    ("613", "1", "791", "< 15 ms", "37 ms"),
    ("831", "1", "573", "57.4 ms", "119 ms"),
)
_DPI = 110


@dataclass(frozen=True, eq=False)
class Column:
    """What became of the second run's scans with one number of references aligned."""

    name: str
    result: MatchResult
    """Of all scans, on the host."""
    seconds: np.ndarray
    """`(scans,)`, each scan's by itself."""
    T_world_query: np.ndarray
    """`(scans, 3)`: where the best hypotheses say that the scans were taken."""
    correct: np.ndarray
    """`(scans,)`: the answer may be acted on, and is right."""
    false: np.ndarray
    """`(scans,)`: the answer may be acted on, and is wrong."""

    def cells(self) -> tuple[str, ...]:
        """The column in the table."""
        correct, false = int(self.correct.sum()), int(self.false.sum())
        mean, maximum = (f"{1e3 * s:.1f} ms" for s in (self.seconds.mean(), self.seconds.max()))
        return str(correct), str(false), str(len(self.correct) - correct - false), mean, maximum


def add_command(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the subcommand to those of the parser."""
    parser = commands.add_parser(
        "demo",
        help="see it work: the paper's experiment in a simulated lab",
        description="Drive two runs through a simulated office floor, match every scan of the "
        "second one with reference scans of the first, and print how many were localized, "
        "beside the paper's own numbers.",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="also write map.png, match.png and table.csv to this folder, made if need be",
    )
    add_lab_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Carry out the subcommand. Raises `CommandError` and `OSError`."""
    if arguments.out is not None:
        make_folder(arguments.out)
    lab = build_lab(arguments)
    columns = _match(lab)
    print(_table(columns, len(lab.references.stamps)))
    if arguments.out is not None:
        _write(arguments.out, lab, columns)


def _match(lab: Lab) -> list[Column]:
    """Every scan of the second run, globally and one at a time, as a robot would."""
    scans = _each(lab.queries.scans)
    start = time.monotonic()
    references = ReferenceSet.build(_each(lab.references.scans))
    configs = [_config(top_k, len(references)) for _, top_k in _COLUMNS]
    for config in configs:
        match(scans[0], references, config)
    print(f"compiled in {time.monotonic() - start:.1f} s", file=sys.stderr)

    columns = []
    with Progress("matching", len(configs) * len(scans)) as progress:
        for (name, _), config in zip(_COLUMNS, configs, strict=True):
            results, seconds = [], []
            for scan in scans:
                began = time.perf_counter()
                results.append(match(scan, references, config))
                seconds.append(time.perf_counter() - began)
                progress.advance(1)
            result = jax.tree.map(lambda *each: np.stack(each), *results)
            columns.append(_column(name, result, np.array(seconds), references, lab))
    return columns


def _config(top_k: int | None, references: int) -> MatchConfig:
    """The defaults with `top_k`; where there are no more references, that is all of them."""
    return MatchConfig(top_k=None if top_k is not None and top_k >= references else top_k)


def _column(
    name: str, result: MatchResult, seconds: np.ndarray, references: ReferenceSet, lab: Lab
) -> Column:
    """The results held against the truth."""
    poses = world_poses(result, references.ids, lab.references.T_world_laser)[:, 0]
    right, confident = is_right(poses, lab.queries.T_world_laser), np.asarray(result.confident)
    return Column(name, result, seconds, poses, confident & right, confident & ~right)


def _each(scans: Scan) -> list[Scan]:
    """The scans of a stack."""
    return [jax.tree.map(lambda array: array[i], scans) for i in range(len(scans.ranges))]  # noqa: B023


def _table(columns: list[Column], references: int) -> str:
    """A Markdown table, aligned to be read as it is, and what it states."""
    scans = len(columns[0].seconds)
    names = [column.name for column in columns]
    cells = zip(*(column.cells() for column in columns), strict=True)
    paper = zip(*_PAPER, strict=True)
    lines = [
        [f"{scans} scans, {references} references", *names, f"paper: {names[0]}", *names[1:]],
        *([row, *mine, *theirs] for row, mine, theirs in zip(_ROWS, cells, paper, strict=True)),
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    rows = [
        [line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))]
        for line in (lines[0], rule, *lines[1:])
    ]
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    angle, threshold = np.degrees(RIGHT_ANGLE), float(MatchConfig().confident)
    return (
        f"{table}\n\nCorrect: within {RIGHT_DISTANCE:g} m and {angle:.0f}° of the truth. "
        f"None: the best hypothesis has a quality below {threshold:.2g}, or a rival.\n"
        "The paper's lab is a real one; its times are those of a 233 MHz Pentium."
    )


def _write(folder: Path, lab: Lab, columns: list[Column]) -> None:
    with atomic_write(folder / "table.csv") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("references aligned", "correct", "false", "none", "mean_ms", "maximum_ms"))
        for column in columns:
            table.writerow((column.name, *(cell.removesuffix(" ms") for cell in column.cells())))
    everything = columns[-1]
    drawn = draw_map(
        lab.plan.world(),
        lab.references.T_world_laser,
        everything.T_world_query,
        everything.correct,
        everything.false,
    )
    _save(drawn, folder / "map.png")
    if everything.correct.any():
        _save(_example(lab, everything), folder / "match.png")


def _example(lab: Lab, column: Column) -> list[Artist]:
    """Of the correct answers, one of high e_m that was taken a metre or more from its reference."""
    result = column.result
    away = np.hypot(*result.T_ref_query[:, 0, :2].T)
    shown = np.minimum(away, 1.0) * result.quality[:, 0]
    query = int(np.argmax(np.where(column.correct, shown, -1.0)))
    return draw_match(
        _each(lab.references.scans)[int(result.reference[query, 0])],
        _each(lab.queries.scans)[query],
        result.T_ref_query[query, 0],
        float(result.quality[query, 0]),
    )


def _save(drawn: list[Artist], path: Path) -> None:
    with atomic_write(path, "wb") as file:
        figure_of(drawn).savefig(file, format="png", dpi=_DPI)
    print(path, file=sys.stderr)
