"""`aprjax sweep`: what thresholds change, where the poses in the logs are the truth."""

import argparse
import json
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import jax
import numpy as np

from aprjax.atomic import atomic_write
from aprjax.cli.errors import CommandError
from aprjax.cli.inputs import (
    add_references,
    gather_references,
    holds_grid,
    holds_references,
    read_entries,
    reference_topic,
    warn_of_damage,
)
from aprjax.cli.outputs import make_folder, shown_path
from aprjax.cli.progress import Progress
from aprjax.cli.sweep_table import write_curves, write_figures, write_rows
from aprjax.configuration import to_dict
from aprjax.io.pieces import Pieces, fingerprint
from aprjax.io.trajectory import TrajectoryError, read_tum
from aprjax.matcher import MatchConfig
from aprjax.metrics import is_near
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.sweeping.axes import check_names, check_values
from aprjax.sweeping.run import CONFIGURATIONS, QUERIES, Piece, sweep_grid

_MOST = 10_000  # configurations
_LARGEST = float(np.finfo(np.float32).max)  # of a threshold
_LATE = 0.5  # seconds outside of a trajectory that a scan may be taken at


def add_command(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the subcommand to those of the parser."""
    parser = commands.add_parser(
        "sweep",
        help="match with many values of thresholds, and score them",
        description="Match every scan of a log with all reference scans, once for each "
        "combination of thresholds, and score the answers. The laser poses that the logs state, or "
        "trajectories beside them, are taken for the truth, in one frame, and only score. Writes "
        "into DIR: sweep.csv (and sweep.parquet where pyarrow is installed), curves.csv and "
        "curves.png (recall, precision and false answers over the threshold on quality), "
        "sweep.png, manifest.json, times.csv. "
        "What is finished is kept in DIR/pieces until all is: started again after an "
        "interruption, the command goes on where it was.",
    )
    add_references(parser)
    for scans in ("reference", "query"):
        parser.add_argument(
            f"--{scans}-poses",
            type=Path,
            metavar="F.tum",
            help=f"true laser poses over the time of the {scans} log, for one that states none, as "
            "a bag does",
        )
    parser.add_argument(
        "--set",
        action=_AddAxis,
        type=_axis,
        required=True,
        default={},
        dest="axes",
        metavar="NAME=START:STOP:COUNT",
        help="a threshold of MatchConfig by its dotted name, such as congruence.tolerance, or of "
        "FeatureConfig, such as features.extraction.surface.window, and its values; more than "
        "once for a grid",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder to write to, made if need be"
    )
    parser.add_argument(
        "--false-rate",
        type=_percent,
        default=0.002,
        metavar="PERCENT",
        help="of the accepted answers that may be wrong for hits; one always may (default: 0.2)",
    )
    parser.add_argument(
        "--mapped",
        type=Path,
        metavar="F",
        help="a file of a 1 for every query that some reference shows, else a 0 (default: those "
        "taken within 2 m and 40° of a reference)",
    )
    parser.add_argument(
        "--no-cascade",
        action="store_true",
        help="go the paper's way: align all references, and evaluate every alignment in full",
    )
    parser.add_argument(
        "--strict", action="store_true", help="stop at a damaged line instead of skipping it"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Carry out the subcommand. Raises `CommandError` and `OSError`."""
    out, axes = arguments.out, arguments.axes
    make_folder(out)
    queries, T_world_query = _read(
        arguments.queries, arguments.topic, arguments.query_poses, strict=arguments.strict
    )
    references, T_world_ref = _references(arguments)
    mapped = _mapped(arguments.mapped, T_world_ref, T_world_query)
    # Only best answers are scored.
    config = MatchConfig(cascade=not arguments.no_cascade, hypotheses=1)
    features = references.config
    at_a_time = CONFIGURATIONS, QUERIES
    run_id = fingerprint(queries, references.scans, references.index, config, axes, at_a_time)
    pieces, done = Pieces(out / "pieces", run_id), []
    count = int(np.prod([len(values) for values in axes.values()]))
    with Progress("sweeping", count * len(mapped)) as progress:

        def watch(piece: Piece) -> None:
            done.append(piece)
            progress.advance(piece.configurations * piece.queries)

        result = sweep_grid(queries, references, axes, config, keep=pieces, watch=watch)

    truth = (references.ids, T_world_ref, T_world_query, mapped)
    rows, answers = write_rows(out, axes, result, truth, arguments.false_rate)
    curves = write_curves(out, answers)
    written = write_figures(out, axes, rows, curves)
    _write_times(out, done)
    manifest = {
        "aprjax": _version(),
        "jax": jax.__version__,
        "backend": jax.default_backend(),
        "references": {"path": shown_path(arguments.references), "scans": len(references)},
        "queries": {"path": shown_path(arguments.queries), "scans": len(mapped)},
        "mapped": shown_path(arguments.mapped)
        if arguments.mapped
        else "within 2 m and 40° of a reference",
        "false_rate": arguments.false_rate,
        "axes": {name: [float(value) for value in values] for name, values in axes.items()},
        "configurations": count,
        "run": run_id,
        "files": written,
        "features": to_dict(features),
        "match": to_dict(config),
    }
    with atomic_write(out / "manifest.json") as file:
        json.dump(manifest, file, indent=1, ensure_ascii=False)
    pieces.discard()
    best = max(rows, key=lambda row: row["hits"])
    where = ", ".join(f"{name} {best[name]:g}" for name in axes)
    print(
        f"{count} configurations, {len(mapped)} queries, {len(references)} references: "
        f"best hits {best['hits']:.3f} at {where}",
        file=sys.stderr,
    )


def _read(
    path: Path, topic: str | None, trajectory: Path | None, *, strict: bool
) -> tuple[Scan, np.ndarray]:
    """The scans of a log, stacked, and their poses `(scans, 3)`."""
    entries, report = read_entries(path, topic, False, strict=strict)
    warn_of_damage(path, report)
    scans = Scan.stack([entry.scan for entry in entries])
    if trajectory is not None:
        return scans, _poses_at([entry.stamp for entry in entries], path, trajectory)
    if any(entry.logged_pose is None for entry in entries):
        raise CommandError(f"{path}: states no poses of its scans, which score the answers")
    return scans, np.array([entry.logged_pose for entry in entries], float)


def _poses_at(stamps: list[float], path: Path, trajectory: Path) -> np.ndarray:
    """The poses `(scans, 3)` of a trajectory at the stamps of a log's scans."""
    try:
        known, poses = read_tum(trajectory)
    except TrajectoryError as error:
        raise CommandError(str(error)) from None
    order = np.argsort(known, kind="stable")
    known, poses = known[order], poses[order]
    for number, stamp in enumerate(stamps):
        if not known[0] - _LATE <= stamp <= known[-1] + _LATE:
            raise CommandError(
                f"{trajectory}: from {known[0]:.3f} to {known[-1]:.3f} s; scan {number} of {path} "
                f"was taken at {stamp:.3f} s"
            )
    poses[:, 2] = np.unwrap(poses[:, 2])
    return np.stack([np.interp(stamps, known, column) for column in poses.T], axis=-1)


def _references(arguments: argparse.Namespace) -> tuple[ReferenceSet, np.ndarray]:
    """The references, which matching knows no poses of, and their poses `(references, 3)`."""
    path = arguments.references
    if not (holds_grid(path) or holds_references(path)):
        scans, poses = _read(
            path, reference_topic(arguments), arguments.reference_poses, strict=arguments.strict
        )
        return ReferenceSet.build(scans), poses
    references = gather_references(arguments)
    if not np.all(np.isfinite(references.T_world_ref)):
        raise CommandError(f"{path}: states no poses of its scans, which score the answers")
    return references, references.T_world_ref


def _mapped(path: Path | None, T_world_ref: np.ndarray, T_world_query: np.ndarray) -> np.ndarray:
    """Which queries some reference shows."""
    if path is None:
        return np.any(is_near(T_world_ref[None], T_world_query[:, None]), axis=1)
    try:
        words = path.read_text(encoding="utf-8").split()
    except ValueError:
        raise CommandError(f"{path}: is no text") from None
    if set(words) - {"0", "1"} or len(words) != len(T_world_query):
        raise CommandError(f"{path}: does not hold {len(T_world_query)} of 0 and 1")
    return np.array(words) == "1"


def _write_times(out: Path, pieces: list[Piece]) -> None:
    """The times, which no two runs share, apart from the table."""
    with atomic_write(out / "times.csv") as file:
        file.write("piece,configurations,queries,seconds,ms_per_scan_and_configuration\n")
        for piece in pieces:
            each = 1e3 * piece.seconds / (piece.configurations * piece.queries)
            file.write(
                f"{piece.name},{piece.configurations},{piece.queries},"
                f"{piece.seconds:.3f},{each:.4f}\n"
            )


def _version() -> str:
    try:
        return metadata.version("aprjax")
    except metadata.PackageNotFoundError:
        return "not installed"


class _AddAxis(argparse.Action):
    """Collects axes by name."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        name, along = values
        axes = {**getattr(namespace, self.dest), name: along}
        if name in getattr(namespace, self.dest):
            parser.error(f"argument --set: {name}: is set twice")
        if np.prod([len(values) for values in axes.values()], dtype=float) > _MOST:
            parser.error(f"argument --set: more than {_MOST} configurations")
        setattr(namespace, self.dest, axes)


def _axis(text: str) -> tuple[str, np.ndarray]:
    """The name and the values of an axis."""
    name, equals, along = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=START:STOP:COUNT")
    try:
        check_names([name])
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    words = along.split(":")
    try:
        start, stop = map(float, words[:2])
        count = int(words[2]) if len(words) == 3 else 0
    except ValueError:
        start, stop, count = 0.0, 0.0, 0
    if not (1 <= count <= _MOST and abs(start) <= _LARGEST and abs(stop) <= _LARGEST):
        raise argparse.ArgumentTypeError(
            f"{name}: {along!r} is not START:STOP:COUNT, two numbers and how many, 1 to {_MOST}"
        )
    if (start == stop) != (count == 1):
        raise argparse.ArgumentTypeError(
            f"{name}: {along!r}: one value has START equal to STOP, as 1:1:1"
        )
    values = np.linspace(start, stop, count, dtype=np.float32)
    try:
        check_values(name, values)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return name, values


def _percent(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 100:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 to 100")
    return value / 100
