"""`aprjax match`: where the scans of one log were taken, with respect to those of another."""

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import numpy as np

from aprjax.batch import match_batch
from aprjax.cli.errors import CommandError
from aprjax.cli.inputs import add_references, gather_references, read_entries, warn_of_damage
from aprjax.cli.outputs import check_outputs
from aprjax.cli.progress import Progress
from aprjax.io.pieces import Pieces, fingerprint
from aprjax.io.reference_file import save_references
from aprjax.io.tables import write_matches
from aprjax.io.trajectory import write_tum
from aprjax.matcher import MatchConfig
from aprjax.plane import compose
from aprjax.references import ReferenceSet
from aprjax.result import MatchResult
from aprjax.scan import Scan
from aprjax.status import Status

_MOST_HYPOTHESES = 1000
_PIECES = (128, 96, 64, 32)  # queries of a call: whole chunks of the matcher


def add_command(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the subcommand to those of the parser."""
    parser = commands.add_parser(
        "match",
        help="match every scan of a log with reference scans",
        description="Match every scan of a log with all reference scans. Only the scans are "
        "used: neither poses nor their order. What is finished is kept beside F.csv until all "
        "is: started again after an interruption, the command goes on where it was.",
    )
    add_references(parser)
    parser.add_argument(
        "--out", required=True, metavar="F.csv", help="the table to write; - is standard output"
    )
    parser.add_argument(
        "--top-k",
        type=_top_k,
        default=None,
        metavar="N|all",
        help="references to compare, those of the highest preselection value (default: all)",
    )
    parser.add_argument(
        "--hypotheses",
        type=_hypotheses,
        default=5,
        metavar="K",
        help=f"most of a query, up to {_MOST_HYPOTHESES} (default: 5)",
    )
    parser.add_argument(
        "--min-quality",
        type=_share,
        default=0.0,
        metavar="E",
        help="least quality of a hypothesis, from 0 to 1 (default: 0)",
    )
    parser.add_argument(
        "--no-cascade",
        action="store_true",
        help="go the paper's way: align all references, and evaluate every alignment in full",
    )
    parser.add_argument(
        "--exclude-self",
        action="store_true",
        help="compare no scan with the reference of its own number, for a log against itself",
    )
    parser.add_argument(
        "--anchors",
        type=_anchors,
        default=None,
        metavar="N",
        help="most anchor points of a scan, 2 to 128 (default: 16, or as the reference file has "
        "it)",
    )
    parser.add_argument(
        "--save-references", type=Path, metavar="F", help="also save the references to a file"
    )
    parser.add_argument(
        "--strict", action="store_true", help="stop at a damaged line instead of skipping it"
    )
    parser.add_argument(
        "--tum",
        type=Path,
        metavar="F.tum",
        help="also write where the scans were taken, of those whose best answer may be acted on, "
        "in the frame of an occupancy grid, or of a reference file that holds poses",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Carry out the subcommand. Raises `CommandError` and `OSError`."""
    inputs = (arguments.references, arguments.queries)
    table = None if arguments.out == "-" else Path(arguments.out)
    check_outputs((table, arguments.save_references, arguments.tum), *inputs)

    entries, report = read_entries(
        arguments.queries, arguments.topic, False, strict=arguments.strict
    )
    references = gather_references(arguments, arguments.anchors, strict=arguments.strict)
    warn_of_damage(arguments.queries, report)
    if arguments.tum and not np.isfinite(references.T_world_ref).all():
        raise CommandError(
            f"{arguments.references}: states no poses, in whose frame --tum would be"
        )
    if arguments.save_references:
        save_references(references, arguments.save_references)

    stacked, config = Scan.stack([entry.scan for entry in entries]), _config(arguments)
    exclude = _own_number(len(entries), references) if arguments.exclude_self else None
    with _kept_pieces(arguments.out, stacked, references, config, exclude) as pieces:
        results, seconds = _match(stacked, references, config, exclude, pieces)
        confident = results.pop("confident")
        _write(arguments.out, results)
        if arguments.tum:
            stamps = np.array([entry.stamp for entry in entries])
            poses = _best_poses(results, references)
            write_tum(arguments.tum, stamps[confident], poses[confident])
    _summarise(len(references), results, seconds)


def _config(arguments: argparse.Namespace) -> MatchConfig:
    return MatchConfig(
        top_k=arguments.top_k,
        cascade=not arguments.no_cascade,
        hypotheses=arguments.hypotheses,
        min_quality=arguments.min_quality,
    )


def _own_number(queries: int, references: ReferenceSet) -> np.ndarray:
    """The id of each query's own reference; -1 where there is none."""
    numbers = np.arange(queries, dtype=np.int32)
    return np.where(np.isin(numbers, references.ids), numbers, -1)[:, None]


@contextmanager
def _kept_pieces(
    out: str,
    queries: Scan,
    references: ReferenceSet,
    config: MatchConfig,
    exclude: np.ndarray | None,
) -> Iterator[Pieces]:
    """Where finished pieces are kept until the block ends without an error.

    Beside the table, or in a passing folder if that is no file but standard output or a device.
    """
    if out == "-" or (Path(out).exists() and not Path(out).is_file()):
        with tempfile.TemporaryDirectory() as folder:
            yield Pieces(Path(folder), "")
        return
    run = fingerprint(queries, references.scans, references.index, config, exclude)
    pieces = Pieces(Path(out).with_name(f"{Path(out).name}.pieces"), run)
    yield pieces
    pieces.discard()


def _match(
    queries: Scan,
    references: ReferenceSet,
    config: MatchConfig,
    exclude: np.ndarray | None,
    pieces: Pieces,
) -> tuple[dict[str, Any], list[tuple[int, float]]]:
    """The columns of the result table, and the queries and seconds of each piece worked on.

    The pieces are of one size, so that one compilation, in the first, serves all.
    """
    count = len(queries.ranges)
    # The size that leaves the last piece fullest.
    size = min(count, min(_PIECES, key=lambda size: -(-count // size) * size))
    columns: list[dict[str, Any]] = []
    seconds: list[tuple[int, float]] = []
    with Progress("matching", count) as progress:
        for start in range(0, count, size):
            began, stop = time.monotonic(), min(start + size, count)
            name = f"{start:08d}-{stop:08d}"
            done = pieces.load(name)
            if done is None:
                piece = jax.tree.map(lambda array: array[start:stop], queries)  # noqa: B023
                # Empty scans fill up the last piece.
                missing = [(0, size - (stop - start)), (0, 0)]
                ids = None if exclude is None else np.pad(exclude[start:stop], missing)
                result = match_batch(piece.pad_batch(size), references, config, exclude=ids)
                done = _columns(jax.tree.map(lambda array: array[: stop - start], result))  # noqa: B023
                pieces.store(name, done)
                seconds.append((stop - start, time.monotonic() - began))
            columns.append(done)
            progress.advance(stop - start)
    return {name: np.concatenate([part[name] for part in columns]) for name in columns[0]}, seconds


def _columns(result: MatchResult) -> dict[str, np.ndarray]:
    """What the table shows of each query, and whether its best answer may be acted on."""
    return {
        "reference": np.asarray(result.reference),
        "pose": np.asarray(result.T_ref_query),
        "quality": np.asarray(result.quality),
        "preselection": np.asarray(result.preselection),
        "valid": np.asarray(result.valid),
        "status": np.array([Status(int(s)).text for s in np.asarray(result.status)]),
        "agreeing_anchors": np.asarray(result.agreeing_anchors),
        "agreeing_beams": np.asarray(result.agreeing_beams),
        "probability": np.asarray(result.probability),
        "confident": np.asarray(result.confident),
    }


def _write(out: str, results: dict[str, Any]) -> None:
    if out != "-":
        write_matches(out, **results)
        return
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "matches.csv"
        write_matches(table, **results)
        sys.stdout.write(table.read_text())
    sys.stdout.flush()


def _best_poses(results: dict[str, Any], references: ReferenceSet) -> np.ndarray:
    """Where the best answers say that the queries were taken: `(queries, 3)`."""
    row = np.searchsorted(references.ids, np.maximum(results["reference"][:, 0], 0))
    row = np.minimum(row, len(references) - 1)
    return compose(references.T_world_ref[row], results["pose"][:, 0].astype(float))


def _summarise(references: int, results: dict[str, Any], seconds: list[tuple[int, float]]) -> None:
    """One line on standard error. The first of several pieces, which compiles, is no measure."""
    queries, found = len(results["status"]), int(results["valid"].sum())
    statuses = Counter(results["status"].tolist())
    print(
        f"{queries} queries, {references} references: {found} hypotheses{_pace(seconds)};",
        ", ".join(f"{name} {count}" for name, count in statuses.most_common()),
        file=sys.stderr,
    )


def _pace(seconds: list[tuple[int, float]]) -> str:
    """The time that matching took, if it was not all done before."""
    if not seconds:
        return ""
    measured = seconds[1:] or seconds
    each = 1e3 * sum(time for _, time in measured) / sum(count for count, _ in measured)
    compiled = "" if len(seconds) > 1 else " with compilation"
    return f" in {sum(time for _, time in seconds):.1f} s, {each:.1f} ms per query{compiled}"


def _top_k(text: str) -> int | None:
    return None if text == "all" else _count(text)


def _share(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 to 1")
    return value


def _hypotheses(text: str) -> int:
    return _count(text, 1, _MOST_HYPOTHESES)


def _anchors(text: str) -> int:
    return _count(text, 2, 128)


def _count(text: str, least: int = 1, most: int = 2**31 - 1) -> int:
    value = int(text) if text.isdecimal() and text.isascii() and len(text) < 11 else 0
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {least} to {most}")
    return value
