"""`aprjax info`: what a file is and what it holds."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import jax
import numpy as np

from aprjax.anchors.extract import Anchors, ExtractionConfig, extract
from aprjax.cli.errors import CommandError
from aprjax.cli.inputs import (
    add_topic_options,
    holds_grid,
    holds_references,
    open_grid,
    open_references,
    read_entries,
)
from aprjax.cli.map import map_facts, open_map
from aprjax.cli.outputs import shown_path
from aprjax.io.bag_file import Topic, bag_topics, is_bag
from aprjax.io.log import LogError, LogReport
from aprjax.io.reference_file import VERSION
from aprjax.io.rosbag import LASER_TYPES, ODOMETRY
from aprjax.numerics import single_precision
from aprjax.scan import Scan
from aprjax.world.store import VERSION as MAP_VERSION
from aprjax.world.store import looks_like_map

_SAMPLE = 64  # scans of which anchors are counted,
_SAMPLE_BEAMS = 1 << 17  # of that many beams together


def add_command(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the subcommand to those of the parser."""
    parser = commands.add_parser(
        "info",
        help="say what a file holds",
        description="Say what a log, bag, reference file, map or occupancy grid holds. Of a bag "
        "with several topics of scans or odometry of which none is chosen, only the topics are "
        "listed.",
    )
    parser.add_argument(
        "file",
        type=Path,
        metavar="FILE",
        help="a log or bag, a reference file, a map, or a grid's YAML",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_topic_options(parser, odometry=True)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Carry out the subcommand. Raises `CommandError` and `OSError`."""
    path = arguments.file
    if holds_grid(path):
        facts = _grid_facts(path)
    elif not holds_references(path):
        facts = _log_facts(path, arguments.topic, arguments.odometry)
    elif looks_like_map(path):
        facts = _map_facts(path)
    else:
        facts = _reference_facts(path)
    facts = {"file": shown_path(path), **facts}
    if arguments.json:
        print(json.dumps(facts, indent=2))
    else:
        for key, value in facts.items():
            print(f"{key.replace('_', ' ')}: {_plain(value)}")


def _log_facts(path: Path, topic: str | None, odometry: str | None) -> dict[str, Any]:
    listed = {}
    if is_bag(path):
        topics = _bag_topics(path)
        listed = {"topics": [f"{each.name} {each.kind} {each.messages}" for each in topics]}
        kinds = [each.kind for each in topics if each.messages]
        lasers, drives = sum(kind in LASER_TYPES for kind in kinds), kinds.count(ODOMETRY)
        if (topic is None and lasers != 1) or (odometry is None and drives > 1):
            return {"kind": "ROS bag", **listed}
    entries, report = read_entries(path, topic, odometry)
    scans = [entry.scan for entry in entries]
    return {
        "kind": report.kind,
        **listed,
        f"{report.unit}s": report.lines,
        "scans": report.scans,
        "lasers": list(report.lasers),
        "scans_of_other_lasers": report.other_lasers,
        **_scan_facts(scans),
        "saturation_m": report.saturation,
        "odometry": _odometry(report),
        f"damaged_{report.unit}s": report.damaged_lines,
        "damage": [f"{report.unit} {number}: {reason}" for number, reason in report.damaged[:3]],
        **_format_facts(report),
        "anchors_per_scan": _mean_anchors(scans),
    }


def _bag_topics(path: Path) -> list[Topic]:
    try:
        return bag_topics(path)
    except LogError as error:
        raise CommandError(str(error)) from None


def _format_facts(report: LogReport) -> dict[str, Any]:
    """What only a CARMEN log has, or only a bag."""
    if report.kind == "ROS bag":
        mounts = {
            topic: [round(float(value), 4) for value in pose]
            for topic, pose in report.T_robot_laser.items()
        }
        return {"odometry_topic": report.odometry, "mounted_at": mounts}
    return {
        "unknown_lines": report.unknown.total(),
        "unknown_kinds": sorted(report.unknown),
    }


def _odometry(report: LogReport) -> bool:
    """Whether entries of the log have odometry that moves."""
    if report.kind == "ROS bag":
        return report.odometry is not None
    return report.moved > 0 or report.lasers[0].startswith("ROBOT")


def _scan_facts(scans: list[Scan]) -> dict[str, Any]:
    """Beams, angles and limits as the range over all scans, and what the beams met."""
    beams = hits = free = 0
    for scan in scans:
        ranges = np.asarray(scan.ranges)
        beams += ranges.size
        hits += int(np.sum((ranges >= scan.range_min) & (ranges <= scan.range_max)))
        free += int(np.sum(np.isposinf(ranges)))
    steps = [math.degrees(scan.angle_increment) for scan in scans]
    counts = [int(scan.beams) for scan in scans]
    turns = [abs(step) * (count - 1) for step, count in zip(steps, counts, strict=True)]
    return {
        "beams": _span(counts),
        "resolution_deg": _span(steps, 3),
        "field_of_view_deg": _span(turns, 1),
        "first_beam_deg": _span([math.degrees(scan.angle_min) for scan in scans], 1),
        "range_min_m": _span([float(scan.range_min) for scan in scans], 3),
        "range_max_m": _span([float(scan.range_max) for scan in scans], 3),
        "hits_share": round(hits / beams, 4),
        "no_return_share": round(free / beams, 4),
        "invalid_share": round((beams - hits - free) / beams, 4),
    }


def _span(values: list[Any], digits: int | None = None) -> Any:
    """The value all have, else the least and the largest."""
    rounded = [value if digits is None else round(value, digits) for value in values]
    low, high = min(rounded), max(rounded)
    return low if low == high else [low, high]


def _mean_anchors(scans: list[Scan]) -> float:
    """Mean number of anchors of a few scans, evenly spread."""
    # Fewer of a great many beams, whose extraction would take gigabytes.
    most = max(min(_SAMPLE, _SAMPLE_BEAMS // max(int(scan.beams) for scan in scans)), 1)
    count = min(len(scans), most)
    sample = Scan.stack([scans[i * len(scans) // count] for i in range(count)])
    with single_precision():
        found = _extract(sample.pad_batch(most), ExtractionConfig())
    return round(float(np.sum(found.valid)) / count, 2)


@jax.jit
def _extract(scans: Scan, config: ExtractionConfig) -> Anchors:
    return jax.vmap(extract, (0, None))(scans, config)


def _reference_facts(path: Path) -> dict[str, Any]:
    references = open_references(path)
    anchors = np.asarray(references.index.features.anchors.valid)[: len(references)]
    return {
        "kind": "reference file",
        "version": VERSION,
        "references": len(references),
        "next_id": references.next_id,
        "beams": _span([int(beams) for beams in references.scans.beams]),
        "anchors_per_scan": round(float(anchors.sum(axis=1).mean()), 2),
        "anchor_capacity": references.config.extraction.anchors,
    }


def _grid_facts(path: Path) -> dict[str, Any]:
    grid = open_grid(path)
    rows, columns = grid.cells.shape
    x, y, yaw = grid.T_world_grid.tolist()
    area = grid.resolution**2
    return {
        "kind": "occupancy grid",
        "resolution_m": grid.resolution,
        "cells": f"{columns} x {rows}",
        "size_m": f"{columns * grid.resolution:.2f} x {rows * grid.resolution:.2f}",
        "origin": f"{x:g} {y:g} {math.degrees(yaw):g}",
        "free_m2": round(float(np.sum(grid.free)) * area, 2),
        "occupied_m2": round(float(np.sum(grid.occupied)) * area, 2),
    }


def _map_facts(path: Path) -> dict[str, Any]:
    """All but the list of cycles, which `aprjax map info` spells out."""
    facts = map_facts(open_map(path))
    facts.pop("cycle_residuals")
    return {"kind": "map file", "version": MAP_VERSION, **facts}


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or value in ([], {}):
        return "none"
    if isinstance(value, dict):
        return ", ".join(f"{name} at {' '.join(map(str, pose))}" for name, pose in value.items())
    if isinstance(value, list):
        between = " to " if isinstance(value[0], int | float) else ", "
        return between.join(map(str, value))
    return str(value)
