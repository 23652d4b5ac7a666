"""NumPy archives as this package writes them, each array checked when it is asked for."""

import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from aprjax.configuration import from_dict, to_dict
from aprjax.features import FeatureConfig
from aprjax.scan import Scan

SCAN_FIELDS = {
    "angle_min": np.float32,
    "angle_increment": np.float32,
    "range_min": np.float32,
    "range_max": np.float32,
    "beams": np.int32,
}
"""The fields of a stacked scan that are `(references,)`; `ranges` is `(references, slots)`."""


class ArchiveError(ValueError):
    """A file that cannot be used: why, in one line without its path."""


def read_archive(path: Path, kind: str) -> "Archive":
    """All arrays of a file that should be of this `kind`, such as "reference file"."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ArchiveError(error.strerror or str(error)) from None
    if not data:
        raise ArchiveError("the file is empty")
    if data[:2] != b"PK":
        raise ArchiveError(f"not a {kind}")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return Archive({name: archive[name] for name in archive.files}, kind)
    # Damage shows as whatever zipfile, zlib or NumPy's parser of headers stumbles over.
    except Exception:
        raise ArchiveError("cut off or damaged: not a readable archive") from None


class Archive:
    """The arrays of a file, each checked when it is asked for."""

    def __init__(self, arrays: dict[str, np.ndarray], kind: str) -> None:
        self._arrays, self._kind = arrays, kind

    def all(self) -> dict[str, np.ndarray]:
        """Every array, unchecked."""
        return dict(self._arrays)

    def get(self, name: str, shape: tuple[int | None, ...], kind: type | str) -> np.ndarray:
        """The array `name` if it has this shape (None: any length) and dtype ("U": text)."""
        array = self._arrays.get(name)
        if not isinstance(array, np.ndarray):
            raise ArchiveError(f"{name} is missing")
        right = array.dtype.kind == kind if isinstance(kind, str) else array.dtype == kind
        if not right:
            wanted = "text" if isinstance(kind, str) else kind.__name__
            raise ArchiveError(f"{name} is {array.dtype}, not {wanted}")
        fits = array.ndim == len(shape) and all(
            want in (None, have) for want, have in zip(shape, array.shape, strict=True)
        )
        if not fits:
            wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
            raise ArchiveError(f"{name} has shape {array.shape}, not {wanted}")
        return array

    def check_format(self, name: str, latest: int) -> int:
        """The version; raise unless the file says this name of its format, and at most `latest`."""
        if "format" not in self._arrays or str(self._arrays["format"]) != name:
            raise ArchiveError(f"an archive, but not a {self._kind}")
        version = int(self.get("version", (), np.int64))
        if version > latest:
            raise ArchiveError(f"version {version} is newer than {latest}, the latest known")
        if version < 1:
            raise ArchiveError(f"version {version} does not exist")
        return version

    def ids(self) -> tuple[np.ndarray, int]:
        """The ids `(references,)` and the next id."""
        ids = self.get("ids", (None,), np.int32)
        next_id = int(self.get("next_id", (), np.int64))
        if not ids.size:
            raise ArchiveError("there are no references")
        if ids[0] < 0:
            raise ArchiveError(f"ids[0]: {ids[0]} is negative")
        # As 64 bits, in which no difference overflows.
        wrong = np.flatnonzero(np.diff(ids.astype(np.int64)) <= 0)
        if wrong.size:
            at = int(wrong[0]) + 1
            raise ArchiveError(f"ids[{at}]: {ids[at]} does not follow {ids[at - 1]}")
        if not ids[-1] < next_id <= np.iinfo(np.int32).max:
            raise ArchiveError(f"next_id: {next_id} does not follow {ids[-1]}")
        return ids, next_id

    def scans(self, count: int) -> Scan:
        """The stacked scans, of which each one is as `Scan.make` demands."""
        ranges = self.get("ranges", (count, None), np.float32)
        fields = {name: self.get(name, (count,), kind) for name, kind in SCAN_FIELDS.items()}
        for name, values in fields.items():
            check_all(np.isfinite(values), f"{name}[{{}}] is not finite")
        low, high = fields["range_min"], fields["range_max"]
        check_all((low >= 0) & (low < high), "range_min[{}] is negative or not below range_max")
        beams, step = fields["beams"], np.abs(fields["angle_increment"]).astype(float)
        check_all(
            (beams >= 0) & (beams <= ranges.shape[1]), "beams[{}] is not a number of the ranges"
        )
        turn = step * np.maximum(beams - 1, 0)
        check_all(
            (step > 0) & (turn <= 2 * np.pi * 1.001), "angle_increment[{}] is zero or too large"
        )
        return Scan(ranges=ranges, **fields)  # pyright: ignore[reportArgumentType]


def check_all(right: np.ndarray, message: str) -> None:
    """Raise with the first index at which something is not right in the message."""
    wrong = np.flatnonzero(~right)
    if wrong.size:
        raise ArchiveError(message.format(wrong[0]))


def read_features(text: str) -> FeatureConfig:
    """A description of scans that was written as JSON."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        raise ArchiveError("features is not JSON") from None
    _check_like(to_dict(FeatureConfig()), values, "features")
    return from_dict(FeatureConfig, values)


def _check_like(default: Any, value: Any, name: str) -> None:
    """Raise unless `value` may stand where `default` does in a configuration's dictionary."""
    if isinstance(default, dict):
        if not isinstance(value, dict):
            raise ArchiveError(f"{name} is not a group of fields")
        for key, inner in value.items():
            if key not in default:
                raise ArchiveError(f"{name} has an unknown field {key!r}")
            _check_like(default[key], inner, f"{name}.{key}")
    elif isinstance(default, float):
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        if not (plain and math.isfinite(value)):
            raise ArchiveError(f"{name} is not a finite number")
    elif not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ArchiveError(f"{name} is not a whole number from 0")
