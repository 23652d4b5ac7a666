"""Reference sets as files: what a set was built from, as one compressed NumPy archive.

Features are not stored but computed again on loading, so a file stays small and never holds
features that another version of this package would describe otherwise.
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
    check_described,
    check_size,
    read_archive,
    read_features,
)
from aprjax.io.files import open_file
from aprjax.references import ReferenceSet, checked_poses

FORMAT = "aprjax references"
VERSION = 2


class ReferenceFileError(ValueError):
    """A reference file that cannot be used. One line: the path and why."""


def save_references(references: ReferenceSet, path: str | os.PathLike[str]) -> None:
    """Write a reference set to exactly `path`, completely or not at all (see `atomic_write`).

    Raises `ValueError` for a set without references or with too many, and for capacities of its
    description that a file may not ask for (over four times the defaults), as `load_references`
    would; `OSError` where it cannot be written.
    """
    if len(references) == 0:
        raise ValueError("references: the set is empty")
    scans, features = references.scans, json.dumps(to_dict(references.config))
    check_size(*np.shape(scans.ranges))
    read_features(features)
    arrays: dict[str, Any] = {
        "format": np.array(FORMAT),
        "version": np.int64(VERSION),
        "ids": np.asarray(references.ids, np.int32),
        "next_id": np.int64(references.next_id),
        "T_world_ref": np.asarray(references.T_world_ref, np.float64),
        "ranges": np.asarray(scans.ranges, np.float32),
        "features": np.array(features),
    }
    for name, kind in SCAN_FIELDS.items():
        arrays[name] = np.asarray(getattr(scans, name), kind)
    with atomic_write(path, "wb") as file:
        np.savez_compressed(file, **arrays)


def load_references(path: str | os.PathLike[str]) -> ReferenceSet:
    """The reference set that `save_references` wrote; it gives bit-identical matches.

    Raises `ReferenceFileError` for a file that cannot be read, is cut off, damaged, of another
    kind or of a newer version, and for contents that no reference set can have.
    """
    try:
        arrays = read_archive(Path(path), "reference file")
        version = arrays.check_format(FORMAT, VERSION)
        ids, next_id = arrays.ids()
        scans = arrays.scans(len(ids))
        poses = _poses(arrays, len(ids)) if version > 1 else None
        config = read_features(str(arrays.get("features", (), "U")))
        check_described(scans, config)
    except ArchiveError as error:
        raise ReferenceFileError(f"{os.fspath(path)}: {error}") from None
    return ReferenceSet.restore(scans, ids, next_id, config, poses)


def looks_like_references(path: str | os.PathLike[str]) -> bool:
    """Whether a file starts as a NumPy archive does.

    Raises `OSError` if it cannot be read, and for a pipe or a device, which is read only once.
    """
    with open_file(Path(path)) as file:
        return file.read(2) == b"PK"


def _poses(arrays: Archive, count: int) -> np.ndarray:
    """The references' poses, NaN where not known."""
    try:
        return checked_poses(arrays.get("T_world_ref", (count, 3), np.float64), count)
    except ValueError as error:
        raise ArchiveError(str(error)) from None
