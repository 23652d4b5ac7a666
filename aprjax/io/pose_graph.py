"""Pose graphs of the plane as text: g2o and TORO.

Both have a line for each vertex and edge; they differ in the tags and in the order of the
information matrix: g2o writes its upper triangle row by row (xx xy xt yy yt tt), TORO the block of
the translation first (xx xy yy tt xt yt).
"""

import math
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from aprjax.atomic import atomic_write
from aprjax.io.files import open_file

Format = Literal["g2o", "toro"]
_LONGEST_LINE = 1 << 16  # bytes
_WORD = 20  # characters of a damaged word that a report shows
_LISTED = 3  # kinds of lines that it names


@dataclass(frozen=True)
class _Layout:
    """How a format writes a graph."""

    vertex: str
    edge: str
    information: tuple[tuple[int, int], ...]
    """The entry of the information matrix that each of an edge's last six numbers is."""


_LAYOUTS = {
    "g2o": _Layout("VERTEX_SE2", "EDGE_SE2", ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))),
    "toro": _Layout("VERTEX2", "EDGE2", ((0, 0), (0, 1), (1, 1), (2, 2), (0, 2), (1, 2))),
}
# TORO's oldest files leave out the dimension.
_TAGS = {tag: layout for layout in _LAYOUTS.values() for tag in (layout.vertex, layout.edge)}
_TAGS |= {"VERTEX": _LAYOUTS["toro"], "EDGE": _LAYOUTS["toro"]}
_SUFFIXES = {".g2o": "g2o", ".graph": "toro", ".toro": "toro"}


class PoseGraphError(ValueError):
    """A graph file that cannot be used. One line: the path, the line number, and why."""


@dataclass(frozen=True, eq=False)
class PoseGraphEdge:
    """A measured relative pose."""

    a: int
    b: int
    T_a_b: np.ndarray
    """`(3,)`: metres and radians."""
    information: np.ndarray
    """`(3, 3)`: the inverse of the covariance of the error of `T_a_b`, its x and y along b's axes,
    as the programs of both formats have it."""


@dataclass(eq=False)
class PoseGraph:
    """Poses, and what was measured between them."""

    poses: dict[int, np.ndarray] = field(default_factory=dict)
    """`T_world_vertex` `(3,)` of each vertex, in metres and radians."""
    edges: list[PoseGraphEdge] = field(default_factory=list)
    fixed: list[int] = field(default_factory=list)
    """Vertices whose poses are given; TORO has no word for them."""
    skipped: Counter[str] = field(default_factory=Counter)
    """Lines of other kinds by their tags, as read: landmarks, parameters, scans."""


def read_pose_graph(path: str | os.PathLike[str]) -> PoseGraph:
    """The graph of a g2o or TORO file; which one, each line's tag says.

    VERTEX_SE2, EDGE_SE2 and FIX are g2o's, VERTEX2 and EDGE2 TORO's; comments (#) and empty lines
    are left out, lines of other tags skipped and counted, and so is a FIX of what is no pose, such
    as a landmark. Angles are taken as they are. Raises
    `PoseGraphError` (a `ValueError`) for a file that cannot be read or has neither vertex nor
    edge, and naming the line for one with another number of fields, an id that is no whole number
    from 0, a number that is not finite, a vertex that is there twice, a matrix that is not
    positive semidefinite, and an edge or FIX of a vertex that is nowhere in the file.
    """
    path = Path(path)
    graph = PoseGraph()
    used: list[tuple[int, int]] = []
    others: set[int] = set()
    for number, words in _lines(path):
        try:
            used += [(number, vertex) for vertex in _add(graph, words, others)]
        except ValueError as error:
            raise PoseGraphError(f"{path}: line {number}: {error}") from None
    # Vertices may follow the edges; without any, as some front ends write, edges are all there is.
    for number, vertex in used if graph.poses else ():
        if vertex not in graph.poses and not (vertex in others and vertex in graph.fixed):
            raise PoseGraphError(f"{path}: line {number}: there is no vertex {vertex}")
    graph.fixed = [vertex for vertex in graph.fixed if vertex not in others]
    if not graph.poses and not graph.edges:
        tags = ", ".join(f"{tag} ({count})" for tag, count in graph.skipped.most_common(_LISTED))
        raise PoseGraphError(
            f"{path}: neither a vertex nor an edge of a g2o or TORO graph of the plane"
            + (f", only {tags}" if tags else "")
        )
    return graph


def write_pose_graph(
    graph: PoseGraph, path: str | os.PathLike[str], file_format: Format | None = None
) -> None:
    """Write a graph as g2o or TORO; by default as the suffix says: .g2o, or .graph or .toro.

    Complete or not there: see `atomic_write`. Raises `ValueError` for another suffix or format and
    as `pose_graph_text` does, and `OSError`.
    """
    chosen = file_format or _SUFFIXES.get(Path(path).suffix)
    if chosen is None:
        raise ValueError(f"path: {path} ends in none of {', '.join(_SUFFIXES)}")
    text = pose_graph_text(graph, chosen)
    with atomic_write(path) as file:
        file.write(text)


def pose_graph_text(graph: PoseGraph, file_format: str) -> str:
    """A graph as the text of a file, vertices by their ids.

    Poses have nine decimals, nanometres and nanoradians, information nine digits. Raises
    `ValueError` naming the field and its value for another format, a shape that does not fit, a
    number that is not finite, a negative id, and an information matrix that is not symmetric.
    """
    if file_format not in _LAYOUTS:
        raise ValueError(f"file_format: {file_format!r} is none of {', '.join(_LAYOUTS)}")
    return "".join(f"{line}\n" for line in _text(graph, _LAYOUTS[file_format]))


def _text(graph: PoseGraph, layout: _Layout) -> Iterator[str]:
    for vertex, pose in sorted(graph.poses.items()):
        yield f"{layout.vertex} {_id(vertex)} {_pose(pose, f'poses[{vertex}]')}"
    if layout is _LAYOUTS["g2o"]:
        for vertex in graph.fixed:
            yield f"FIX {_id(vertex)}"
    for index, edge in enumerate(graph.edges):
        name = f"edges[{index}]"
        matrix = np.asarray(edge.information, float)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
            raise ValueError(f"{name}.information: {matrix.tolist()} is not 3 x 3 finite numbers")
        if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-9 * abs(matrix).max()):
            raise ValueError(f"{name}.information: {matrix.tolist()} is not symmetric")
        entries = " ".join(f"{matrix[entry]:.9g}" for entry in layout.information)
        ends = f"{_id(edge.a)} {_id(edge.b)}"
        yield f"{layout.edge} {ends} {_pose(edge.T_a_b, f'{name}.T_a_b')} {entries}"


def _id(vertex: int) -> int:
    if vertex < 0:
        raise ValueError(f"vertex {vertex}: an id is a whole number from 0")
    return vertex


def _pose(pose: np.ndarray, name: str) -> str:
    values = np.asarray(pose, float)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise ValueError(f"{name}: {values.tolist()} is not three finite numbers")
    return " ".join(f"{value:.9f}" for value in values)


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and words of all lines that hold some and are no comment."""
    number = 0
    try:
        with open_file(path) as file:
            while line := file.readline(_LONGEST_LINE):
                number += 1
                # Lines of scans may be long; of one that is longer still, the rest is left out.
                rest = line
                while len(rest) == _LONGEST_LINE and not rest.endswith(b"\n"):
                    rest = file.readline(_LONGEST_LINE)
                words = line.decode(errors="replace").split()
                if words and not words[0].startswith("#"):
                    yield number, words
    except OSError as error:
        raise PoseGraphError(f"{path}: {error.strerror or error}") from None


def _add(graph: PoseGraph, words: list[str], others: set[int]) -> Iterable[int]:
    """Take a line into the graph; the vertices that it must not be alone in naming.

    Those that are no poses, such as landmarks, are noted in `others`.
    """
    tag = words[0]
    if tag == "FIX":
        graph.fixed += (vertices := [_read_id(word) for word in words[1:]])
        return vertices
    layout = _TAGS.get(tag)
    if layout is None:
        graph.skipped[tag[:_WORD]] += 1
        if tag.startswith("VERTEX") and len(words) > 1 and _is_id(words[1]):
            others.add(int(words[1]))
        return ()
    if tag.startswith("VERTEX"):
        _expect(words, 5)
        vertex = _read_id(words[1])
        if vertex in graph.poses:
            raise ValueError(f"vertex {vertex} is there twice")
        graph.poses[vertex] = _numbers(words[2:])
        return ()
    _expect(words, 12)
    a, b = _read_id(words[1]), _read_id(words[2])
    numbers = _numbers(words[3:])
    information = np.zeros((3, 3))
    for (row, column), value in zip(layout.information, numbers[3:], strict=True):
        information[row, column] = information[column, row] = value
    if np.linalg.eigvalsh(information)[0] < -1e-6 * max(abs(information).max(), 1e-30):
        raise ValueError(f"the information {' '.join(words[6:])} is not positive semidefinite")
    graph.edges.append(PoseGraphEdge(a, b, numbers[:3], information))
    return a, b


def _expect(words: list[str], count: int) -> None:
    if len(words) != count:
        raise ValueError(f"{words[0]} has {len(words)} fields, not {count}")


def _read_id(word: str) -> int:
    if not _is_id(word):
        raise ValueError(f"{word[:_WORD]!r} is not a vertex's number")
    return int(word)


def _is_id(word: str) -> bool:
    return word.isdecimal() and word.isascii() and len(word) < 19


def _numbers(words: list[str]) -> np.ndarray:
    for word in words:
        try:
            finite = math.isfinite(float(word))
        except ValueError:
            raise ValueError(f"{word[:_WORD]!r} is not a number") from None
        if not finite:
            raise ValueError(f"{word[:_WORD]} is not finite")
    return np.array([float(word) for word in words])
