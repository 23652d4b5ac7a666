"""Reference sets as files: what a set was built from, as one compressed NumPy archive.

Features are not stored but computed again on loading, so a file stays small and never holds
features that another version of this package would describe otherwise.
"""

import io
import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from aprjax.configuration import from_dict, to_dict
from aprjax.features import FeatureConfig
from aprjax.io.atomic import atomic_write
from aprjax.references import ReferenceSet
from aprjax.scan import Scan

FORMAT = "aprjax references"
VERSION = 2

_SCALARS = {
    "angle_min": np.float32,
    "angle_increment": np.float32,
    "range_min": np.float32,
    "range_max": np.float32,
    "beams": np.int32,
}
"""The fields of a stacked scan that are `(references,)`; `ranges` is `(references, slots)`."""


class ReferenceFileError(ValueError):
    """A reference file that cannot be used. One line: the path and why."""


def save_references(references: ReferenceSet, path: str | os.PathLike[str]) -> None:
    """Write a reference set to exactly `path`, completely or not at all (see `atomic_write`).

    Raises `ValueError` for a set without references and `OSError` where it cannot be written.
    """
    if len(references) == 0:
        raise ValueError("references: the set is empty")
    scans = references.scans
    arrays: dict[str, Any] = {
        "format": np.array(FORMAT),
        "version": np.int64(VERSION),
        "ids": np.asarray(references.ids, np.int32),
        "next_id": np.int64(references.next_id),
        "T_world_ref": np.asarray(references.T_world_ref, np.float32),
        "ranges": np.asarray(scans.ranges, np.float32),
        "features": np.array(json.dumps(to_dict(references.index.config))),
    }
    for name, kind in _SCALARS.items():
        arrays[name] = np.asarray(getattr(scans, name), kind)
    with atomic_write(path, "wb") as file:
        np.savez_compressed(file, **arrays)


def load_references(path: str | os.PathLike[str]) -> ReferenceSet:
    """The reference set that `save_references` wrote; it gives bit-identical matches.

    Raises `ReferenceFileError` for a file that cannot be read, is cut off, damaged, of another
    kind or of a newer version, and for contents that no reference set can have.
    """
    try:
        arrays = _Arrays(_read(Path(path)))
        arrays.check_format()
        ids, next_id = arrays.ids()
        scans = arrays.scans(len(ids))
        poses = arrays.poses(len(ids))
        config = _config(str(arrays.get("features", (), "U")))
    except ReferenceFileError as error:
        raise ReferenceFileError(f"{os.fspath(path)}: {error}") from None
    return ReferenceSet.restore(scans, ids, next_id, config, poses)


def looks_like_references(path: str | os.PathLike[str]) -> bool:
    """Whether a file starts as a NumPy archive does. Raises `OSError` if it cannot be read."""
    with Path(path).open("rb") as file:
        return file.read(2) == b"PK"


def _read(path: Path) -> dict[str, np.ndarray]:
    """All arrays of an archive."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ReferenceFileError(error.strerror or str(error)) from None
    if not data:
        raise ReferenceFileError("the file is empty")
    if data[:2] != b"PK":
        raise ReferenceFileError("not a reference file")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    # Damage shows as whatever zipfile, zlib or NumPy's parser of headers stumbles over.
    except Exception:
        raise ReferenceFileError("cut off or damaged: not a readable archive") from None


class _Arrays:
    """The arrays of a file, each checked when it is asked for."""

    def __init__(self, arrays: dict[str, np.ndarray]) -> None:
        self._arrays = arrays

    def get(self, name: str, shape: tuple[int | None, ...], kind: type | str) -> np.ndarray:
        """The array `name` if it has this shape (None: any length) and dtype ("U": text)."""
        array = self._arrays.get(name)
        if not isinstance(array, np.ndarray):
            raise ReferenceFileError(f"{name} is missing")
        right = array.dtype.kind == kind if isinstance(kind, str) else array.dtype == kind
        if not right:
            wanted = "text" if isinstance(kind, str) else kind.__name__
            raise ReferenceFileError(f"{name} is {array.dtype}, not {wanted}")
        fits = array.ndim == len(shape) and all(
            want in (None, have) for want, have in zip(shape, array.shape, strict=True)
        )
        if not fits:
            wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
            raise ReferenceFileError(f"{name} has shape {array.shape}, not {wanted}")
        return array

    def check_format(self) -> None:
        """Raise unless this is a reference file of a version that is known."""
        if "format" not in self._arrays or str(self._arrays["format"]) != FORMAT:
            raise ReferenceFileError("an archive, but not a reference file")
        version = int(self.get("version", (), np.int64))
        if version > VERSION:
            raise ReferenceFileError(f"version {version} is newer than {VERSION}, the latest known")
        if version < 1:
            raise ReferenceFileError(f"version {version} does not exist")

    def ids(self) -> tuple[np.ndarray, int]:
        """The ids `(references,)` and the next id."""
        ids = self.get("ids", (None,), np.int32)
        next_id = int(self.get("next_id", (), np.int64))
        if not ids.size:
            raise ReferenceFileError("there are no references")
        if ids[0] < 0:
            raise ReferenceFileError(f"ids[0]: {ids[0]} is negative")
        # As 64 bits, in which no difference overflows.
        wrong = np.flatnonzero(np.diff(ids.astype(np.int64)) <= 0)
        if wrong.size:
            at = int(wrong[0]) + 1
            raise ReferenceFileError(f"ids[{at}]: {ids[at]} does not follow {ids[at - 1]}")
        if not ids[-1] < next_id <= np.iinfo(np.int32).max:
            raise ReferenceFileError(f"next_id: {next_id} does not follow {ids[-1]}")
        return ids, next_id

    def poses(self, count: int) -> np.ndarray | None:
        """The references' poses, NaN where not known; files of version 1 have none."""
        if int(self.get("version", (), np.int64)) < 2:
            return None
        poses = self.get("T_world_ref", (count, 3), np.float32)
        _all(~np.any(np.isinf(poses), axis=1), "T_world_ref[{}] is infinite")
        return poses

    def scans(self, count: int) -> Scan:
        """The stacked scans, of which each one is as `Scan.make` demands."""
        ranges = self.get("ranges", (count, None), np.float32)
        fields = {name: self.get(name, (count,), kind) for name, kind in _SCALARS.items()}
        for name, values in fields.items():
            _all(np.isfinite(values), f"{name}[{{}}] is not finite")
        low, high = fields["range_min"], fields["range_max"]
        _all((low >= 0) & (low < high), "range_min[{}] is negative or not below range_max")
        beams, step = fields["beams"], np.abs(fields["angle_increment"]).astype(float)
        _all((beams >= 0) & (beams <= ranges.shape[1]), "beams[{}] is not a number of the ranges")
        turn = step * np.maximum(beams - 1, 0)
        _all((step > 0) & (turn <= 2 * np.pi * 1.001), "angle_increment[{}] is zero or too large")
        return Scan(ranges=ranges, **fields)  # pyright: ignore[reportArgumentType]


def _all(right: np.ndarray, message: str) -> None:
    wrong = np.flatnonzero(~right)
    if wrong.size:
        raise ReferenceFileError(message.format(wrong[0]))


def _config(text: str) -> FeatureConfig:
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        raise ReferenceFileError("features is not JSON") from None
    _check_like(to_dict(FeatureConfig()), values, "features")
    return from_dict(FeatureConfig, values)


def _check_like(default: Any, value: Any, name: str) -> None:
    """Raise unless `value` may stand where `default` does in a configuration's dictionary."""
    if isinstance(default, dict):
        if not isinstance(value, dict):
            raise ReferenceFileError(f"{name} is not a group of fields")
        for key, inner in value.items():
            if key not in default:
                raise ReferenceFileError(f"{name} has an unknown field {key!r}")
            _check_like(default[key], inner, f"{name}.{key}")
    elif isinstance(default, float):
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if not (plain and math.isfinite(value)):
            raise ReferenceFileError(f"{name} is not a finite number")
    elif not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ReferenceFileError(f"{name} is not a whole number from 0")
