"""`aprjax localize`: where a robot was in a map, scan by scan, from its scans and odometry."""

import argparse
import logging
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from aprjax.atomic import atomic_write
from aprjax.cli.errors import CommandError
from aprjax.cli.inputs import add_laser, add_topic_options, read_drive
from aprjax.cli.map import open_map, warn_of_parts
from aprjax.cli.outputs import check_outputs, make_folder
from aprjax.cli.progress import Progress
from aprjax.io.log import LogEntry
from aprjax.io.tables import HypothesisRow, write_hypotheses
from aprjax.io.trajectory import write_tum
from aprjax.plane import compose
from aprjax.plot.hypotheses import draw_hypotheses, picture_of
from aprjax.plot.style import figure_of
from aprjax.tracking.apr import MatchedSource
from aprjax.tracking.belief import Belief, Situation
from aprjax.tracking.classes import scan_source
from aprjax.tracking.replay import replay
from aprjax.tracking.sources import ValidationSource
from aprjax.tracking.table import hypothesis_rows
from aprjax.tracking.tracker import HypothesisTracker
from aprjax.tracking.validation import IdcSource
from aprjax.world.model import WorldModel
from aprjax.world.parts import WorldModelError
from aprjax.world.super_space import assemble

_DPI, _FILM_DPI = 110, 60
_FRAMES = 100  # of a film, at most


def add_command(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the subcommand to those of the parser."""
    parser = commands.add_parser(
        "localize",
        help="track position hypotheses in a map",
        description="Localize a robot in a map from its scans and raw odometry, from nothing known "
        "and through kidnappings. After each scan, the table has a row for every hypothesis.",
    )
    parser.add_argument("map", type=Path, metavar="MAP", help="a map that `map build` wrote")
    parser.add_argument("log", type=Path, metavar="LOG", help="a log or bag with odometry")
    parser.add_argument(
        "--out", required=True, metavar="F.csv", help="the table to write; - is standard output"
    )
    parser.add_argument(
        "--tum",
        type=Path,
        metavar="F.tum",
        help="also write the strongest hypothesis after each scan that leaves the robot tracked "
        "(neither lost nor ambiguous), as a trajectory in the map's assembled frame",
    )
    parser.add_argument(
        "--pictures",
        type=Path,
        metavar="DIR",
        help="also draw the hypotheses over the map after the scans of --cycles, as PNG",
    )
    parser.add_argument(
        "--cycles",
        type=_cycles,
        default=(1, 32, 75, 106),
        metavar="N,N,...",
        help="scans after which to draw, counted from 1 (default: 1,32,75,106)",
    )
    parser.add_argument("--gif", type=Path, metavar="F.gif", help="also draw the whole run")
    parser.add_argument(
        "--scan-classes",
        action="store_true",
        help="also let classes of scans confirm and weaken hypotheses",
    )
    add_laser(parser)
    parser.add_argument(
        "--strict", action="store_true", help="stop at a damaged line instead of skipping it"
    )
    add_topic_options(parser, odometry=True)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Carry out the subcommand. Raises `CommandError` and `OSError`."""
    table = None if arguments.out == "-" else Path(arguments.out)
    check_outputs((table, arguments.tum, arguments.gif), arguments.map, arguments.log)
    if arguments.pictures:
        make_folder(arguments.pictures)
    world = _load(arguments.map)
    entries = read_drive(arguments)
    # One line for each trouble of a source; progress is on the same stream.
    logging.basicConfig(format="aprjax: %(message)s", stream=sys.stderr)
    start = time.monotonic()
    beliefs = _track(entries, _tracker(world, arguments))
    try:
        rows = hypothesis_rows(world, beliefs)
    except WorldModelError as error:
        raise CommandError(f"{arguments.map}: {error}") from None
    _write(arguments.out, rows)
    frame = assemble(world)
    if arguments.tum:
        _write_trajectory(arguments.tum, frame, entries, beliefs)
    seconds = time.monotonic() - start
    if arguments.pictures:
        _draw(arguments.pictures, world, frame, beliefs, arguments.cycles)
    if arguments.gif:
        _animate(arguments.gif, world, frame, beliefs)
    if arguments.pictures or arguments.gif:
        warn_of_parts(arguments.map, "nodes", world.nodes, frame)
    _summarise(beliefs, seconds)


def _load(path: Path) -> WorldModel:
    world = open_map(path)
    if not world.appearances:
        raise CommandError(f"{path}: the map has no reference scans")
    return world


def _tracker(world: WorldModel, arguments: argparse.Namespace) -> HypothesisTracker:
    """The default sources, and what the arguments add to them."""
    validation: list[ValidationSource] = [IdcSource()]
    if arguments.scan_classes:
        if len(world.appearances) < 2:
            raise CommandError(f"{arguments.map}: one reference scan makes no classes")
        validation.append(scan_source(world))
    return HypothesisTracker(
        world,
        primary=[MatchedSource()],
        validation=validation,
    )


def _track(entries: list[LogEntry], tracker: HypothesisTracker) -> list[Belief]:
    """What is believed after each scan."""
    with Progress("localizing", len(entries)) as progress:
        return list(replay(tracker, entries, progress.advance))


def _write(out: str, rows: list[HypothesisRow]) -> None:
    if out != "-":
        write_hypotheses(out, rows)
        return
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "hypotheses.csv"
        write_hypotheses(table, rows)
        sys.stdout.write(table.read_text())
    sys.stdout.flush()


def _write_trajectory(
    path: Path, frame: dict[int, np.ndarray], entries: list[LogEntry], beliefs: list[Belief]
) -> None:
    """The best hypotheses where the robot is tracked, in the frame of the first node.

    Parts of the map that this node does not reach have no place in it: poses there are left out,
    and counted on standard error.
    """
    tracked = [
        (entry.stamp, belief.best.place)
        for entry, belief in zip(entries, beliefs, strict=True)
        if belief.best is not None and belief.situation is Situation.TRACKING
    ]
    placed = [(stamp, place) for stamp, place in tracked if place.node in frame]
    stamps = [stamp for stamp, _ in placed]
    poses = [compose(frame[place.node], place.T_node_laser) for _, place in placed]
    write_tum(path, np.array(stamps), np.array(poses).reshape(-1, 3))
    warn_of_parts(path, "poses", [place.node for _, place in tracked], frame)


def _draw(
    folder: Path,
    world: WorldModel,
    frame: dict[int, np.ndarray],
    beliefs: list[Belief],
    cycles: tuple[int, ...],
) -> None:
    """The paper's Fig. 7, a file for each of the scans that there are."""
    for cycle in cycles:
        if cycle <= len(beliefs):
            belief, title = beliefs[cycle - 1], f"after cycle {cycle}"
            figure = figure_of(draw_hypotheses(world, frame, belief, title))
            with atomic_write(folder / f"cycle-{cycle:04d}.png", "wb") as file:
                figure.savefig(file, format="png", dpi=_DPI)


def _animate(
    path: Path, world: WorldModel, frame: dict[int, np.ndarray], beliefs: list[Belief]
) -> None:
    """The run as a film of at most a hundred pictures."""
    shown = range(0, len(beliefs), -(-len(beliefs) // _FRAMES))
    pictures = []
    with Progress("drawing", len(shown)) as progress:
        for scan in shown:
            drawn = draw_hypotheses(world, frame, beliefs[scan], f"after cycle {scan + 1}")
            pictures.append(picture_of(figure_of(drawn), _FILM_DPI))
            progress.advance(1)
    with atomic_write(path, "wb") as file:
        pictures[0].save(
            file, format="GIF", save_all=True, append_images=pictures[1:], duration=150, loop=0
        )


def _cycles(text: str) -> tuple[int, ...]:
    words = text.split(",")
    if not all(word.isdecimal() and word.isascii() and int(word) > 0 for word in words):
        raise argparse.ArgumentTypeError(f"{text!r} is no list of whole numbers from 1")
    return tuple(map(int, words))


def _summarise(beliefs: list[Belief], seconds: float) -> None:
    """One line on standard error."""
    situations = Counter(belief.situation.value for belief in beliefs)
    each = 1e3 * seconds / len(beliefs)
    print(
        f"{len(beliefs)} scans in {seconds:.1f} s, {each:.1f} ms each with compilation;",
        ", ".join(f"{name} {count}" for name, count in situations.most_common()),
        file=sys.stderr,
    )
