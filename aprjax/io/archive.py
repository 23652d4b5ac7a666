"""NumPy archives as this package writes them, each array checked when it is asked for.

Nothing in a file is executed, and what it claims to hold is held against its size before any
memory is taken for it.
"""

import json
import math
import os
import warnings
import zipfile
from pathlib import Path
from typing import IO, Any

import jax
import numpy as np

from aprjax.configuration import from_dict, to_dict
from aprjax.features import FeatureConfig, describe
from aprjax.io.files import MOST_BEAMS, most_unpacked, open_file
from aprjax.scan import Scan, check_columns

SCAN_FIELDS = {
    "angle_min": np.float32,
    "angle_increment": np.float32,
    "range_min": np.float32,
    "range_max": np.float32,
    "beams": np.int32,
}
"""The fields of a stacked scan that are `(references,)`; `ranges` is `(references, slots)`."""


MOST_REFERENCES = 1 << 17
_MOST_BYTES = 1 << 32  # of all arrays of a file, and of what is described of its scans
_CAPACITY = 4  # times its default that a capacity in a file may be
_LARGEST = float(np.finfo(np.float32).max)  # as which thresholds are kept
_LOADED_UNCHECKED = 1 << 14  # references that stay below _MOST_BYTES with any such capacities
_FORMAT_BYTES = 1 << 10
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


class ArchiveError(ValueError):
    """A file that cannot be used: why, in one line without its path."""


def read_archive(path: Path, kind: str) -> "Archive":
    """All arrays of a file that should be of this `kind`, such as "reference file"."""
    try:
        with open_file(path) as file:
            head = file.read(2)
            if not head:
                raise ArchiveError("the file is empty")
            if head != b"PK":
                raise ArchiveError(f"not a {kind}")
            return Archive(_arrays(file), kind)
    except OSError as error:
        raise ArchiveError(error.strerror or str(error)) from None


def archive_format(path: Path) -> str | None:
    """What a file says its format is; None if that is no archive of this package's.

    Raises `OSError` if it cannot be read.
    """
    with open_file(path) as file:
        # Damage shows as whatever zipfile, zlib or NumPy's parser of headers stumbles over.
        try:
            with zipfile.ZipFile(file) as archive:
                member = archive.getinfo("format.npy")
                return str(_array(archive, member)) if member.file_size < _FORMAT_BYTES else None
        except Exception:
            return None


def _arrays(file: IO[bytes]) -> dict[str, np.ndarray]:
    size = os.fstat(file.fileno()).st_size
    try:
        with zipfile.ZipFile(file) as archive:
            members = [each for each in archive.infolist() if each.filename.endswith(".npy")]
            claimed = sum(member.file_size for member in members)
            if claimed > min(_MOST_BYTES, most_unpacked(size)):
                raise ArchiveError(f"claims to hold {claimed} bytes, too many for its {size}")
            return {
                member.filename.removesuffix(".npy"): _array(archive, member) for member in members
            }
    except ArchiveError:
        raise
    except Exception:
        raise ArchiveError("cut off or damaged: not a readable archive") from None


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """One array of plain numbers or text. Raises whatever damage leads to.

    Not `np.load`, which takes the memory that a header asks for before it looks for the contents.
    """
    if member.compress_type not in _METHODS:
        raise ValueError("packed in a way that NumPy does not use")
    with archive.open(member) as stream:
        read_header = _HEADERS[np.lib.format.read_magic(stream)]
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a header in need of mending is none of this package's
            shape, transposed, dtype = read_header(stream)
        if dtype.kind not in "biufU" or min(shape, default=0) < 0:
            raise ValueError("neither numbers nor text")
        length = math.prod(shape) * dtype.itemsize
        if length != member.file_size - stream.tell():
            raise ValueError("the header does not fit the contents")
        data = bytearray(stream.read(length))  # so that the array can be written to
    if len(data) != length:
        raise ValueError("cut off")
    array = np.frombuffer(data, dtype) if length else np.empty(0, dtype)
    return array.reshape(shape[::-1]).T if transposed else array.reshape(shape)


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
        check_size(*ranges.shape)
        fields = {name: self.get(name, (count,), kind) for name, kind in SCAN_FIELDS.items()}
        try:
            check_columns(fields, ranges.shape[1])
        except ValueError as error:
            raise ArchiveError(str(error)) from None
        return Scan(ranges=ranges, **fields)  # pyright: ignore[reportArgumentType]


def check_size(references: int, beams: int) -> None:
    """Raise unless a file may hold so many references of so many beams."""
    if references > MOST_REFERENCES:
        raise ArchiveError(f"{references} references are more than {MOST_REFERENCES}")
    if beams < 1:
        raise ArchiveError("ranges has no beams")
    if beams > MOST_BEAMS:
        raise ArchiveError(f"{beams} beams are more than {MOST_BEAMS}")


def check_described(scans: Scan, features: FeatureConfig) -> None:
    """Raise if what is described of a file's scans would take more memory than a file may ask for.

    A few bytes of a file can stand for a scan whose features are thousands.
    """
    count, slots = np.shape(scans.ranges)
    if count <= _LOADED_UNCHECKED and count * slots <= _MOST_BYTES >> 8:
        return
    one = jax.tree.map(lambda array: array[0], scans)
    described = jax.tree.leaves(jax.eval_shape(describe, one, features))
    size = count * sum(leaf.size * leaf.dtype.itemsize for leaf in described)
    if size > _MOST_BYTES:
        raise ArchiveError(f"its {count} references would take {size} bytes when described")


def read_features(text: str) -> FeatureConfig:
    """A description of scans that was written as JSON."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        raise ArchiveError("features is not JSON") from None
    _check_like(to_dict(FeatureConfig()), values, "features")
    try:
        return from_dict(FeatureConfig, values)
    except ValueError as error:
        raise ArchiveError(f"features: {error}") from None


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
        if not (plain and abs(value) <= _LARGEST):
            raise ArchiveError(f"{name} is not a finite number")
    elif not isinstance(value, int) or isinstance(value, bool) or value < _least(name):
        raise ArchiveError(f"{name} is not a whole number from {_least(name)}")
    elif value > _CAPACITY * default:
        raise ArchiveError(f"{name} is over {_CAPACITY * default}")


def _least(name: str) -> int:
    """What a capacity of this name is at least: an array has an entry, a tolerance may be none."""
    return 0 if name.endswith("_tolerance") else 1
