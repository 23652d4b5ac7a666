"""Occupancy grids as ROS's map_server keeps them: a YAML file, and a PGM image beside it.

The modes are those of nav2's `map_io`: `negate` turns black and white about except in raw mode.
"""

import json
import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from aprjax.atomic import atomic_write
from aprjax.grid.occupancy_grid import (
    COARSEST,
    FINEST,
    FREE,
    MOST_CELLS,
    OCCUPIED,
    UNKNOWN,
    OccupancyGrid,
)
from aprjax.io.files import open_file

Mode = Literal["trinary", "scale", "raw"]
_MODES = ("trinary", "scale", "raw")
_YAML_BYTES = 1 << 16
_HEADER_BYTES = 1 << 16
_DIGITS = 9  # of a number in a PGM's header, at most
_PLAIN_BYTES = 16  # of a pixel in a plain PGM, at most: its number and the space around it
_USUAL = {FREE: 254, UNKNOWN: 205}  # map_saver's greys
_SAVED = {0, *_USUAL.values()}  # all that map_saver paints with
_UNKNOWN_ABOVE = 0.196  # the free_thresh under which map_saver's grey of unknown is unknown
_LEVELS = np.arange(256)
_FLAGS = {"0": False, "1": True} | dict.fromkeys(("false", "no", "off"), False)
_FLAGS |= dict.fromkeys(("true", "yes", "on"), True)
_T = TypeVar("_T")


class OccupancyGridError(ValueError):
    """A grid file that cannot be used. One line: the path, the field or line, and why."""


@dataclass(frozen=True)
class _Shades:
    """What the grey of a pixel means."""

    mode: str
    negate: bool
    occupied_thresh: float
    free_thresh: float

    def cells(self, shade: np.ndarray) -> np.ndarray:
        """int8 cells of shades from 0 (black) to 1 (white)."""
        if self.mode == "raw":
            level = np.rint(255 * shade)
            return np.where(level <= OCCUPIED, level, UNKNOWN).astype(np.int8)
        occupied = shade if self.negate else 1 - shade
        between: Any = UNKNOWN
        if self.mode == "scale":
            span = self.occupied_thresh - self.free_thresh
            between = np.clip(np.rint(100 * (occupied - self.free_thresh) / span), 0, 100)
        cells = np.where(occupied > self.occupied_thresh, OCCUPIED, between)
        return np.where(occupied < self.free_thresh, FREE, cells).astype(np.int8)

    def levels(self) -> dict[int, int]:
        """For each value of a cell that one of 256 greys means, such a grey."""
        meant = self.cells(_LEVELS / 255)
        chosen = {}
        for value in np.unique(meant).tolist():
            fitting = np.flatnonzero(meant == value)
            light = fitting[::-1] if self.negate else fitting
            # The whitest for free, the blackest for occupied, else one from the middle.
            at = {FREE: -1, OCCUPIED: 0}.get(value, len(light) // 2)
            chosen[value] = int(light[at])
        if self.mode == "trinary":
            chosen |= {value: grey for value, grey in _USUAL.items() if meant[grey] == value}
        return chosen


def read_occupancy_grid(path: str | os.PathLike[str]) -> OccupancyGrid:
    """The grid of a map_server YAML file and the PGM image (P2 or P5) that it names.

    All modes: trinary (the default), scale, raw. The image's first row is the grid's last; the
    origin is the pose of the image's lower left corner. The image's path is relative to the YAML
    file's folder; keys that map_server does not know are ignored.

    A trinary image of map_saver's three greys alone is read as what they mean, also where
    `free_thresh` is above 0.196: nav2's map_saver wrote 0.25 for years, by which the grey that it
    paints the unknown with, 205, would be free, and the whole image floor.

    Raises `OccupancyGridError` (a `ValueError`) naming the file, the field and its value for a
    file that cannot be read, a key that is missing or makes no sense, a resolution not from 0.1 mm
    to 1 km, and an image that is no PGM, is cut off, has over 2²⁸ pixels, or a pixel above its
    maximum. Sizes are checked against the file before anything is allocated.
    """
    path = Path(path)
    values = _read_yaml(path)

    def field(name: str, read: Callable[[Any], _T]) -> _T:
        if name not in values:
            raise OccupancyGridError(f"{path}: {name} is missing")
        try:
            return read(values[name])
        except ValueError as error:
            raise OccupancyGridError(f"{path}: {name}: {error}") from None

    image = field("image", _name)
    resolution = field("resolution", _width)
    origin = field("origin", _pose)
    occupied, free = field("occupied_thresh", _share), field("free_thresh", _share)
    if not free < occupied:
        raise OccupancyGridError(
            f"{path}: free_thresh: {free} is not below occupied_thresh {occupied}"
        )
    mode = field("mode", _mode) if "mode" in values else "trinary"
    shades = _Shades(mode, field("negate", _flag), occupied, free)

    image_path = path.parent / image
    levels, maximum = _read_pgm(image_path)
    if mode == "trinary" and not shades.negate and _only_saved(levels, maximum):
        shades = replace(shades, free_thresh=min(free, _UNKNOWN_ABOVE))
    # By a table of all greys: an array of shades would take eight times the image.
    table = shades.cells(np.arange(maximum + 1) / maximum)
    return OccupancyGrid.make(table[levels[::-1]], resolution, origin)


def write_occupancy_grid(
    grid: OccupancyGrid,
    path: str | os.PathLike[str],
    *,
    mode: Mode = "trinary",
    negate: bool = False,
    occupied_thresh: float = 0.65,
    free_thresh: float = 0.196,
    plain: bool = False,
) -> None:
    """Write a grid as the YAML file `path` and a PGM image of the same name with .pgm.

    Trinary writes what is `occupied`, `free`, and unknown; scale and raw all values as they are.
    The image is binary (P5), or if `plain` text (P2). `read_occupancy_grid` reads back the same
    cells, and the resolution and origin to the bit. Each file is complete or not there, the
    image first: see `atomic_write`.

    Raises `ValueError` naming the field and its value for a mode that does not exist, for
    thresholds not from 0 to 1 or in the wrong order, for a path that ends in .pgm, and for a cell
    that no grey of the mode means (unknown in scale: a PGM has no transparency); `OSError`.
    """
    path = Path(path)
    if path.suffix == ".pgm":
        raise ValueError(f"path: {path} is the image's name, not the YAML file's")
    if mode not in _MODES:
        raise ValueError(f"mode: {mode!r} is none of {', '.join(_MODES)}")
    if not 0 <= free_thresh < occupied_thresh <= 1:
        raise ValueError(
            f"free_thresh: {free_thresh} is not from 0 to occupied_thresh {occupied_thresh}, "
            "or that is over 1"
        )
    known = _Shades(mode, negate, occupied_thresh, free_thresh).levels()
    cells = grid.cells
    if mode == "trinary":
        cells = np.where(grid.occupied, OCCUPIED, np.where(grid.free, FREE, UNKNOWN))
    for value in np.unique(cells).tolist():
        if value not in known:
            row, column = np.argwhere(cells == value)[0].tolist()
            raise ValueError(
                f"cells[{row}, {column}]: no grey means {value} in mode {mode} with thresholds "
                f"{free_thresh} and {occupied_thresh}"
            )
    table = np.array([known.get(value, 0) for value in range(UNKNOWN, OCCUPIED + 1)], np.uint8)
    image = path.with_suffix(".pgm")
    with atomic_write(image, "wb") as file:
        _write_pgm(file, table[cells[::-1].astype(np.intp) - UNKNOWN], plain)
    x, y, yaw = grid.T_world_grid.tolist()
    plain_name = re.fullmatch(r"[A-Za-z_][\w.+-]*", image.name, re.ASCII)
    with atomic_write(path) as file:
        file.write(
            f"image: {image.name if plain_name else json.dumps(image.name)}\n"
            f"mode: {mode}\n"
            f"resolution: {grid.resolution!r}\n"
            f"origin: [{x!r}, {y!r}, {yaw!r}]\n"
            f"negate: {int(negate)}\n"
            f"occupied_thresh: {occupied_thresh!r}\n"
            f"free_thresh: {free_thresh!r}\n"
        )


def _read_yaml(path: Path) -> dict[str, Any]:
    """The keys of a flat YAML mapping: texts, and lists of texts.

    All that map_server's files use, and nothing that could refer to itself or grow.
    """
    try:
        with open_file(path) as file:
            data = file.read(_YAML_BYTES + 1)
    except OSError as error:
        raise OccupancyGridError(f"{path}: {error.strerror or error}") from None
    if len(data) > _YAML_BYTES:
        raise OccupancyGridError(f"{path}: over {_YAML_BYTES} bytes are no map_server file")
    values: dict[str, Any] = {}
    name, opened = "", False
    lines = data.decode("utf-8-sig", errors="replace").splitlines()
    indent = None
    for number, line in enumerate(lines, 1):
        text = _without_comment(line).strip()
        if not text or text in ("---", "...") or text.startswith("%YAML"):
            continue
        depth = len(line) - len(line.lstrip())
        indent = depth if indent is None else indent
        match = re.fullmatch(r"([\w-]+)\s*:(?:\s+(.*))?", text)
        if opened:
            values[name] += " " + text
        elif text.startswith("- ") and isinstance(values.get(name), list | None) and name:
            values[name] = [*(values[name] or []), text[2:].strip()]
            continue
        elif match and depth == indent:
            name = match[1]
            if name in values:
                raise OccupancyGridError(f"{path}: line {number}: {name} is there twice")
            values[name] = match[2] or None
        else:
            raise OccupancyGridError(f"{path}: line {number}: {text[:40]!r} is not key: value")
        flow = values[name] or ""
        opened = flow.startswith("[") and not flow.endswith("]")
        if flow.startswith("[") and not opened:
            values[name] = [part.strip() for part in flow[1:-1].split(",")]
    return values


def _without_comment(line: str) -> str:
    """The line up to a # that begins a comment: one in no quotes, after a space."""
    quote = ""
    for at, char in enumerate(line):
        if quote:
            quote = "" if char == quote else quote
        elif char in "'\"":
            quote = char
        elif char == "#" and (at == 0 or line[at - 1].isspace()):
            return line[:at]
    return line


def _name(value: Any) -> str:
    text = _text(value)
    if text[0] == text[-1] == '"' and len(text) > 1:
        text = json.loads(text)
    elif text[0] == text[-1] == "'" and len(text) > 1:
        text = text[1:-1].replace("''", "'")
    try:
        name = os.fsencode(text)
    except UnicodeEncodeError:
        name = b""
    if not name or b"\0" in name:
        raise ValueError(f"{text[:40]!r} is no file's name")
    return text


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{'a list' if value else 'nothing'} is not one value")
    return value


def _number(value: Any) -> float:
    text = _text(value)
    try:
        number = float(text)
    except ValueError:
        raise ValueError(f"{text[:40]!r} is not a number") from None
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is not finite")
    return number


def _width(value: Any) -> float:
    number = _number(value)
    if not FINEST <= number <= COARSEST:
        raise ValueError(f"{number} m is not from {FINEST} to {COARSEST}")
    return number


def _share(value: Any) -> float:
    number = _number(value)
    if not 0 <= number <= 1:
        raise ValueError(f"{number} is not from 0 to 1")
    return number


def _pose(value: Any) -> list[float]:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f"{str(value)[:40]!r} is not [x, y, yaw]")
    return [_number(part) for part in value]


def _flag(value: Any) -> bool:
    text = _text(value)
    if text.lower() not in _FLAGS:
        raise ValueError(f"{text[:40]!r} is none of {', '.join(_FLAGS)}")
    return _FLAGS[text.lower()]


def _mode(value: Any) -> str:
    text = _name(value).lower()
    if text not in _MODES:
        raise ValueError(f"{text[:40]!r} is none of {', '.join(_MODES)}")
    return text


def _only_saved(levels: np.ndarray, maximum: int) -> bool:
    """Whether an image holds no other greys than map_saver's."""
    present = np.zeros(maximum + 1, bool)
    for row in levels:
        present[row] = True
    return maximum == len(_LEVELS) - 1 and {*np.flatnonzero(present).tolist()} <= _SAVED


def _read_pgm(path: Path) -> tuple[np.ndarray, int]:
    """Grey levels `(height, width)` of an image, the first row uppermost, and that of white."""
    try:
        with open_file(path) as file:
            try:
                return _parse_pgm(file)
            except ValueError as error:
                raise OccupancyGridError(f"{path}: {error}") from None
    except OSError as error:
        raise OccupancyGridError(f"{path}: {error.strerror or error}") from None


def _parse_pgm(file: Any) -> tuple[np.ndarray, int]:
    head = file.read(_HEADER_BYTES)
    if head.startswith(b"\x89PNG"):
        raise ValueError("a PNG image; convert it to PGM (P2 or P5)")
    if head[:2] not in (b"P2", b"P5"):
        raise ValueError("not a PGM image (P2 or P5)")
    gap = rb"(?:\s|#[^\n\r]*[\n\r])+"
    header = re.match(rb"P[25]" + 3 * (gap + rb"(\d+)") + rb"(?:#[^\n\r]*[\n\r]|\s)", head)
    if not header:
        raise ValueError("its header is not width, height and maximum")
    for name, text in zip(("width", "height", "maximum"), header.groups(), strict=True):
        if len(text) > _DIGITS or int(text) < 1:
            raise ValueError(f"{name}: {text[:20].decode()} is not from 1 to {10**_DIGITS - 1}")
    width, height, maximum = map(int, header.groups())
    if maximum > 65535:
        raise ValueError(f"maximum: {maximum} is over 65535")
    pixels = width * height
    if pixels > MOST_CELLS:
        raise ValueError(f"width: {width} x {height} pixels are more than {MOST_CELLS}")
    size = os.fstat(file.fileno()).st_size - header.end()
    file.seek(header.end())
    if head[:2] == b"P5":
        levels = _binary(file, size, pixels, np.dtype("u1" if maximum < 256 else ">u2"))
    else:
        levels = _plain(file, size, pixels)
    levels = levels.reshape(height, width)
    if levels.max() > maximum:
        row, column = np.argwhere(levels > maximum)[0].tolist()
        raise ValueError(
            f"pixel at row {row}, column {column}: {levels[row, column]} is above {maximum}"
        )
    return levels, maximum


def _binary(file: Any, size: int, pixels: int, dtype: np.dtype) -> np.ndarray:
    wanted = pixels * dtype.itemsize
    if size < wanted:
        raise ValueError(f"cut off: {size} bytes of pixels, not {wanted}")
    data = file.read(wanted)
    if file.read(_HEADER_BYTES).strip() or len(data) < wanted:
        raise ValueError(f"{size} bytes of pixels, not {wanted}")
    return np.frombuffer(data, dtype)


def _plain(file: Any, size: int, pixels: int) -> np.ndarray:
    if not 2 * pixels - 1 <= size <= _PLAIN_BYTES * (pixels + _HEADER_BYTES):
        raise ValueError(f"{size} bytes cannot be {pixels} pixels")
    data = re.sub(rb"#[^\n\r]*", b"", file.read(size))
    strange = data.translate(None, b"0123456789 \t\r\n\v\f")
    if strange:
        raise ValueError(f"pixels: {strange[:1].decode(errors='replace')!r} is not in a number")
    # As float32, which no number of digits overflows into a grey.
    levels = np.fromstring(data, np.float32, sep=" ") if data.strip() else np.zeros(0, np.float32)
    if len(levels) != pixels:
        raise ValueError(f"{len(levels)} pixels, not {pixels}")
    return np.minimum(levels, 65536).astype(np.uint32)


def _write_pgm(file: Any, levels: np.ndarray, plain: bool) -> None:
    height, width = levels.shape
    file.write(f"P{2 if plain else 5}\n{width} {height}\n255\n".encode())
    if not plain:
        file.write(levels.tobytes())
        return
    for row in levels:
        # The format asks for lines of at most 70 characters.
        for start in range(0, width, 17):
            file.write(b" ".join(b"%d" % level for level in row[start : start + 17]) + b"\n")
