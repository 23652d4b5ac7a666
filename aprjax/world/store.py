"""World models as files: everything but the references' features in one compressed NumPy archive.

As a reference file does, a map keeps scans and describes them again when they are matched, so
that it is read fast and never holds what another version of this package would describe otherwise.
"""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from aprjax.atomic import atomic_write
from aprjax.configuration import to_dict
from aprjax.io.archive import (
    SCAN_FIELDS,
    Archive,
    ArchiveError,
    archive_format,
    check_described,
    check_size,
    read_archive,
    read_features,
)
from aprjax.scan import Scan
from aprjax.world.model import WorldModel
from aprjax.world.parts import KINDS, Appearance, Arc, Place, WorldModelError

FORMAT = "aprjax map"
VERSION = 1

_NONE = -1  # in place of the number of a scan that there is not


class MapFileError(ValueError):
    """A map file that cannot be used. One line: the path and why."""


def save_map(world: WorldModel, path: str | os.PathLike[str]) -> None:
    """Write a world model to exactly `path`, completely or not at all (see `atomic_write`).

    Raises `ValueError` for a model without nodes or with too many references, `WorldModelError`
    for an inconsistent one, and `OSError` where it cannot be written.
    """
    if not world.nodes:
        raise ValueError("world: there is no node")
    world.check()
    arrays = _packed(world)
    check_size(*arrays["ranges"].shape)
    with atomic_write(path, "wb") as file:
        np.savez_compressed(file, **arrays)


def load_map(path: str | os.PathLike[str]) -> WorldModel:
    """The world model that `save_map` wrote.

    Raises `MapFileError` for a file that cannot be read, is cut off, damaged, of another kind or
    of a newer version, and for contents that no world model can have.
    """
    try:
        arrays = read_archive(Path(path), "map file")
        arrays.check_format(FORMAT, VERSION)
        return _unpacked(arrays)
    except (ArchiveError, WorldModelError) as error:
        raise MapFileError(f"{os.fspath(path)}: {error}") from None


def looks_like_map(path: str | os.PathLike[str]) -> bool:
    """Whether a file says that it is a map. Raises `OSError` if it cannot be read."""
    return archive_format(Path(path)) == FORMAT


def _packed(world: WorldModel) -> dict[str, Any]:
    nodes, arcs = world.nodes, list(world.arcs())
    node_scans = [world.graph.nodes[node]["scan"] for node in nodes]
    arrays: dict[str, Any] = {
        "format": np.array(FORMAT),
        "version": np.int64(VERSION),
        "features": np.array(json.dumps(to_dict(world.features))),
        "nodes": np.array(nodes, np.int64),
        "node_scans": _numbers(node_scans),
        "arcs": np.array([(arc.a, arc.b) for arc in arcs], np.int64).reshape(-1, 2),
        "arc_poses": _poses([arc.T_a_b for arc in arcs]),
        "arc_covariances": np.array([arc.covariance for arc in arcs], float).reshape(-1, 3, 3),
        "arc_kinds": np.array([KINDS.index(arc.kind) for arc in arcs], np.int64),
        "next_id": np.int64(world.next_reference),
        "place_scans": np.array(sorted(world.places), np.int64),
        **_places("place", [place for _, place in sorted(world.places.items())]),
    }
    for name, seen in (("reference", world.appearances), ("image", world.images)):
        appearances = [appearance for _, appearance in sorted(seen.items())]
        arrays[f"{name}_ids"] = np.array(sorted(seen), np.int64)
        arrays[f"{name}_scans"] = _numbers([appearance.scan for appearance in appearances])
        arrays.update(_places(name, [appearance.place for appearance in appearances]))
        if name == "image":
            classes = [appearance.image_class for appearance in appearances]
            arrays["image_classes"] = np.array(classes, np.int64)
    scans = [scan for _, scan in sorted(world.reference_scans.items())]
    stacked = Scan.stack(scans) if scans else None
    arrays["ranges"] = np.zeros((0, 1), np.float32) if stacked is None else stacked.ranges
    for name, kind in SCAN_FIELDS.items():
        arrays[name] = np.asarray([] if stacked is None else getattr(stacked, name), kind)
    return arrays


def _unpacked(arrays: Archive) -> WorldModel:
    world = WorldModel(read_features(str(arrays.get("features", (), "U"))))
    nodes = arrays.get("nodes", (None,), np.int64)
    if not len(nodes):
        raise ArchiveError("there are no nodes")
    node_scans = arrays.get("node_scans", nodes.shape, np.int64)
    for node, scan in zip(nodes.tolist(), node_scans.tolist(), strict=True):
        world.add_node(_number(scan), node)

    ends = arrays.get("arcs", (None, 2), np.int64)
    poses = arrays.get("arc_poses", (len(ends), 3), np.float64)
    covariances = arrays.get("arc_covariances", (len(ends), 3, 3), np.float64)
    kinds = arrays.get("arc_kinds", (len(ends),), np.int64)
    for (a, b), T, covariance, kind in zip(ends.tolist(), poses, covariances, kinds, strict=True):
        if not 0 <= kind < len(KINDS):
            raise ArchiveError(f"arc {a}-{b}: its kind {kind} does not exist")
        world.add_arc(Arc(a, b, T, covariance, KINDS[kind]))

    numbers = _ascending(arrays, "place_scans")
    for number, place in zip(
        numbers.tolist(), _read_places(arrays, "place", len(numbers)), strict=True
    ):
        world.place_scan(number, place)
    _read_references(arrays, world)
    classes = arrays.get("image_classes", (None,), np.int64)
    numbers, appearances = _read_appearances(arrays, "image", len(classes))
    for number, appearance, image_class in zip(
        numbers.tolist(), appearances, classes.tolist(), strict=True
    ):
        world.add_image(Appearance(appearance.place, appearance.scan, image_class), number)
    world.check()
    return world


def _read_references(arrays: Archive, world: WorldModel) -> None:
    count = len(_ascending(arrays, "reference_ids"))
    ids, appearances = _read_appearances(arrays, "reference", count)
    scans = arrays.scans(count)
    check_described(scans, world.features)
    fields = {name: np.asarray(getattr(scans, name)) for name in ("ranges", *SCAN_FIELDS)}
    each = [Scan(**{name: array[row] for name, array in fields.items()}) for row in range(count)]  # pyright: ignore[reportArgumentType]
    next_id = int(arrays.get("next_id", (), np.int64))
    if count and ids[-1] >= next_id:
        raise ArchiveError(f"next_id: {next_id} does not follow {ids[-1]}")
    world.restore_references(ids.tolist(), each, appearances, next_id)


def _ascending(arrays: Archive, name: str) -> np.ndarray:
    """Numbers `(any,)` of which each is larger than the one before it, the first from 0."""
    numbers = arrays.get(name, (None,), np.int64)
    if numbers.size and numbers[0] < 0:
        raise ArchiveError(f"{name}[0]: {numbers[0]} is negative")
    wrong = np.flatnonzero(numbers[1:] <= numbers[:-1]) + 1
    if wrong.size:
        at = wrong[0]
        raise ArchiveError(f"{name}[{at}]: {numbers[at]} does not follow {numbers[at - 1]}")
    return numbers


def _read_appearances(
    arrays: Archive, name: str, count: int
) -> tuple[np.ndarray, list[Appearance]]:
    ids = arrays.get(f"{name}_ids", (count,), np.int64)
    scans = arrays.get(f"{name}_scans", (count,), np.int64)
    places = _read_places(arrays, name, count)
    return ids, [
        Appearance(place, _number(scan)) for place, scan in zip(places, scans.tolist(), strict=True)
    ]


def _places(name: str, places: list[Place]) -> dict[str, np.ndarray]:
    return {
        f"{name}_nodes": np.array([place.node for place in places], np.int64),
        f"{name}_poses": _poses([place.T_node_laser for place in places]),
    }


def _read_places(arrays: Archive, name: str, count: int) -> list[Place]:
    nodes = arrays.get(f"{name}_nodes", (count,), np.int64)
    poses = arrays.get(f"{name}_poses", (count, 3), np.float64)
    return [Place(node, T) for node, T in zip(nodes.tolist(), poses, strict=True)]


def _poses(poses: list[np.ndarray]) -> np.ndarray:
    return np.array(poses, float).reshape(-1, 3)


def _numbers(scans: list[int | None]) -> np.ndarray:
    return np.array([_NONE if scan is None else scan for scan in scans], np.int64)


def _number(scan: int) -> int | None:
    return None if scan == _NONE else scan
