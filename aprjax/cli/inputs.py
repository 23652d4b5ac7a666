"""Logs and references as the commands read them: what is wrong becomes a `CommandError`."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from aprjax.anchors.extract import ExtractionConfig
from aprjax.cli.errors import CommandError
from aprjax.features import FeatureConfig
from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.io.log import LogEntry, LogError, LogReport
from aprjax.io.logs import read_log
from aprjax.io.occupancy_grid import OccupancyGridError, read_occupancy_grid
from aprjax.io.reference_file import ReferenceFileError, load_references, looks_like_references
from aprjax.plane import compose
from aprjax.references import ReferenceSet
from aprjax.scan import Scan

_SHOWN = 3  # damaged lines spelled out


def add_references(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of references and queries, and the options that choose from them."""
    parser.add_argument(
        "references",
        type=Path,
        metavar="REFERENCES",
        help="a log or bag, a saved reference file, or an occupancy grid (the YAML file)",
    )
    parser.add_argument("queries", type=Path, metavar="QUERIES", help="a log or bag")
    add_topic_options(parser)
    parser.add_argument(
        "--reference-topic", metavar="T", help="the same for REFERENCES (default: as --topic)"
    )


def gather_references(
    arguments: argparse.Namespace, anchors: int | None = None, *, strict: bool = False
) -> ReferenceSet:
    """The references that `add_references` asked for; with so many anchors each, if told."""
    path = arguments.references
    config = FeatureConfig()
    if anchors is not None:
        config = FeatureConfig(extraction=ExtractionConfig(anchors=anchors))
    if holds_grid(path):
        return _references_of_grid(path, config)
    if holds_references(path):
        references = open_references(path)
        capacity = references.config.extraction.anchors
        if anchors not in (None, capacity):
            raise CommandError(f"{path}: was saved with {capacity} anchors, not {anchors}")
        return references
    scans, report = read_scans(path, reference_topic(arguments), strict=strict)
    warn_of_damage(path, report)
    return ReferenceSet.build(scans, config)


def reference_topic(arguments: argparse.Namespace) -> str | None:
    """What to take from a log of references."""
    return arguments.topic if arguments.reference_topic is None else arguments.reference_topic


def holds_grid(path: Path) -> bool:
    """Whether the file is, by its name, a map_server grid's."""
    return path.suffix in (".yaml", ".yml") and not path.is_dir()


def open_grid(path: Path) -> OccupancyGrid:
    """An occupancy grid."""
    try:
        return read_occupancy_grid(path)
    except OccupancyGridError as error:
        raise CommandError(str(error)) from None


def _references_of_grid(path: Path, config: FeatureConfig) -> ReferenceSet:
    """What a laser would see from places that cover the floor of a grid."""
    grid = open_grid(path)
    try:
        return ReferenceSet.from_occupancy_grid(grid, config)
    except ValueError as error:
        raise CommandError(f"{path}: {error}") from None


def holds_references(path: Path) -> bool:
    """Whether the file is a saved reference set rather than a log."""
    if path.is_dir():
        return False  # a bag of ROS 2
    try:
        return looks_like_references(path)
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None


def open_references(path: Path) -> ReferenceSet:
    """A saved reference set."""
    try:
        return load_references(path)
    except ReferenceFileError as error:
        raise CommandError(str(error)) from None


def add_topic_options(parser: argparse.ArgumentParser, *, odometry: bool = False) -> None:
    """Add the options that choose from what a log holds."""
    parser.add_argument(
        "--topic",
        metavar="T",
        help="topic of a bag's scans, or laser message of a CARMEN log (default: the only topic, "
        "the preferred message)",
    )
    if odometry:
        parser.add_argument(
            "--odometry",
            metavar="T",
            help="topic of a bag's odometry, or /tf for its frame odom (default: the only topic, "
            "else /tf)",
        )


def add_laser(parser: argparse.ArgumentParser) -> None:
    """Add the option that says where the laser sits, for `read_drive`."""
    parser.add_argument(
        "--laser",
        type=_pose,
        metavar="X,Y,DEG",
        help="where the laser sits on the robot, whose pose a log's odometry gives: metres ahead "
        "and to the left, degrees counter-clockwise (default: 0,0,0, or as a bag says)",
    )


def _pose(text: str) -> tuple[float, float, float]:
    try:
        x, y, degrees = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not X,Y,DEG") from None
    if not np.all(np.isfinite([x, y, degrees])):
        raise argparse.ArgumentTypeError(f"{text!r} is not finite")
    return x, y, float(np.radians(degrees))


def read_entries(
    path: Path, topic: str | None, odometry: str | Literal[False] | None, *, strict: bool = False
) -> tuple[list[LogEntry], LogReport]:
    """All scans of a log or bag with their odometry, and what it holds."""
    lasers: Sequence[str] | None = None if topic is None else [topic]
    try:
        log = read_log(path, lasers=lasers, odometry=odometry, strict=strict)
        return list(log), log.report
    except LogError as error:
        raise CommandError(str(error)) from None
    except ValueError as error:
        raise CommandError(f"{path}: {error}") from None


def read_drive(arguments: argparse.Namespace) -> list[LogEntry]:
    """All scans of a command's log, which must have odometry; says what of it is damaged.

    The odometry is the laser's, as `--laser` says where it is mounted.
    """
    path = arguments.log
    entries, report = read_entries(
        path, arguments.topic, arguments.odometry, strict=arguments.strict
    )
    warn_of_damage(path, report)
    poses = [entry.odometry for entry in entries if entry.odometry is not None]
    if len(poses) < len(entries):
        raise CommandError(f"{path}: there is no odometry")
    if len(poses) > 1 and not np.ptp(poses, axis=0).any():
        print(f"{path}: by its odometry the robot never moves", file=sys.stderr)
    if arguments.laser is None:
        return entries
    if any(laser in report.T_robot_laser for laser in report.lasers):
        raise CommandError(f"--laser: {path} itself says where its laser sits")
    odometry = compose(np.array(poses), np.array(arguments.laser))
    return [replace(entry, odometry=pose) for entry, pose in zip(entries, odometry, strict=True)]


def read_scans(
    path: Path, topic: str | None = None, *, strict: bool = False
) -> tuple[list[Scan], LogReport]:
    """All scans of a log or bag, and what it holds; nothing else of it is looked at."""
    entries, report = read_entries(path, topic, False, strict=strict)
    return [entry.scan for entry in entries], report


def warn_of_damage(path: Path, report: LogReport) -> None:
    """Say on standard error how much was skipped as damaged, and why the first ones."""
    if not report.damaged_lines:
        return
    print(f"{path}: skipped {report.damaged_lines} damaged {report.unit}s", file=sys.stderr)
    for number, reason in report.damaged[:_SHOWN]:
        print(f"  {report.unit} {number}: {reason}", file=sys.stderr)
