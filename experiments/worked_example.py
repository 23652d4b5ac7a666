"""The worked example of the paper's Fig. 2: two small anchor graphs, aligned step by step.

    python -m experiments.worked_example --out DIR [--quick]

G_2 is a true subgraph of the larger G_1, its anchor points numbered otherwise; the edges (1, 2)
and (2, 4) of G_1 are as long as (2, 3) of G_2. The points are ours, chosen so that all that the
paper's text says of its example holds. Writes into DIR:

- `worked_example.png`: the graphs; the correspondence matrix of all pairs of edges, whose maximum
  is in line 2, column 3; the matching angle histogram with its peak at 30°; the matrix of the
  edges that belong to the peak; and G_2 aligned with G_1;
- `correspondences.csv`: the pairs of edges of equal length, the rotation that each suggests, and
  whether both are the same edge;
- `worked_example.csv`: the maxima of the matrices, the largest entry that identifies two anchors
  wrongly, the rotation, and the transformation with its distance from the true one;
- `configuration.json`. It takes seconds, so --quick changes nothing.
"""

import argparse
import sys
from itertools import combinations
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aprjax.alignment.align import AlignmentConfig, align
from aprjax.alignment.correspondence import CorrespondenceConfig, correspondence_matrices
from aprjax.alignment.rotation import RotationConfig, rotation_peaks
from aprjax.anchors.extract import Anchors
from aprjax.plane import transform
from aprjax.relations.graph import AnchorGraph, anchor_graph
from aprjax.relations.histograms import RelationConfig, direction_spectrum, matching_angles
from aprjax.sweeping.axes import configured
from experiments.outputs import BLUE, print_table, write_configuration, write_figure, write_table

G_1 = np.array([[-3.7588, 1.3681], [0.0, 0.0], [-1.2, -2.2], [0.3486, 3.9848]])
G_2 = np.array([[-2.8802, -1.0887], [-3.3122, 3.2807], [-0.7410, 0.2165]])
SAME_POINT = {1: 3, 2: 1, 3: 2}  # anchor of G_2: anchor of G_1
T_1_2 = np.array([0.75, 0.183, np.radians(30)])
ANY_ANGLE = configured(CorrespondenceConfig(), {"angle": np.pi})
SLOTS = 4
COLOURS = {"G_1": BLUE, "G_2": "#d9480f"}


def graph(xy: np.ndarray) -> AnchorGraph:
    """The complete graph over points `(n, 2)` in metres."""
    missing = SLOTS - len(xy)
    return anchor_graph(
        Anchors(
            xy=jnp.asarray(np.pad(xy, [(0, missing), (0, 0)]), jnp.float32),
            kind=jnp.zeros(SLOTS, jnp.int32),
            salience=jnp.ones(SLOTS),
            valid=jnp.arange(SLOTS) < len(xy),
            overflow=jnp.int32(0),
        )
    )


def correspondences() -> list[dict]:
    """A row for each pair of edges of equal length; anchors are counted from 1, as there."""
    rows = []
    for a, b in combinations(range(len(G_1)), 2):
        for v, w in combinations(range(len(G_2)), 2):
            one, other = G_1[b] - G_1[a], G_2[w] - G_2[v]
            off = np.hypot(*one) - np.hypot(*other)
            if abs(off) > float(CorrespondenceConfig().length):
                continue
            turn = np.degrees(np.arctan2(*one[::-1]) - np.arctan2(*other[::-1]))
            rows.append(
                {
                    "e_1": f"({a + 1} {b + 1})",
                    "e_2": f"({v + 1} {w + 1})",
                    "length_m": round(float(np.hypot(*one)), 3),
                    "rotation_deg": round(float((turn + 90) % 180 - 90), 2),
                    "same_edge": {SAME_POINT[v + 1], SAME_POINT[w + 1]} == {a + 1, b + 1},
                }
            )
    return rows


@jax.jit
def solve(one: AnchorGraph, other: AnchorGraph):
    """Both matrices, the matching angle histogram, its peak, and the alternatives."""
    relation = RelationConfig()
    of_one, of_other = (direction_spectrum(each, relation)[None] for each in (one, other))
    histogram = matching_angles(of_other, of_one, relation)[0, 0]
    rotations = rotation_peaks(histogram, RotationConfig(peaks=1))
    within = correspondence_matrices(one, other, rotations.angle, CorrespondenceConfig())
    everything = correspondence_matrices(one, other, rotations.angle, ANY_ANGLE)[0]
    config = AlignmentConfig()
    return everything, histogram, rotations.angle, within, align(one, other, histogram, config)


def misled(matrix: np.ndarray) -> int:
    """The largest entry of two anchors that are not the same point."""
    right = {(i - 1, j - 1) for j, i in SAME_POINT.items()}
    return int(max(count for place, count in np.ndenumerate(matrix) if place not in right))


def draw(everything, histogram, within, T_found) -> Figure:
    """The steps in their order."""
    figure = Figure(figsize=(14.0, 7.6), layout="constrained")
    axes = figure.subplots(2, 3)
    _draw_graph(axes[0, 0], G_1, "G_1", COLOURS["G_1"], "reference graph G_1")
    _draw_graph(axes[0, 1], G_2, "G_2", COLOURS["G_2"], "graph of the scan G_2")
    _draw_matrix(axes[0, 2], everything, "matrix of all pairs of edges")
    degrees = np.arange(len(histogram)) * 180 / len(histogram)
    axes[1, 0].bar(degrees, histogram, width=2.6, color="#8a8a8a")
    axes[1, 0].set(xlabel="rotation / °, modulo 180", title="matching angle histogram")
    _draw_matrix(axes[1, 1], within, "matrix of the pairs in the peak")
    moved = transform(T_found, G_2)
    _draw_graph(axes[1, 2], G_1, "G_1", COLOURS["G_1"], "")
    _draw_graph(
        axes[1, 2],
        moved,
        "G_2",
        COLOURS["G_2"],
        f"aligned: x {T_found[0]:.2f} m, y {T_found[1]:.2f} m, θ {np.degrees(T_found[2]):.1f}°",
        below=True,
    )
    return figure


def _draw_graph(
    ax: Axes, xy: np.ndarray, name: str, colour: str, title: str, below: bool = False
) -> None:
    for a, b in combinations(range(len(xy)), 2):
        style = "--" if below else "-"
        ax.plot(*xy[[a, b]].T, color=colour, linewidth=1.2, ls=style)
    style = {"textcoords": "offset points", "ha": "center", "va": "center", "fontsize": 11}
    for number, point in enumerate(xy, 1):
        ax.plot(*point, "o", color=colour, markersize=6)
        # Those of the graph below another stand beyond the other's numbers.
        offset = (24 if below else 12) * _away(point, G_1 if below else xy)
        ax.annotate(str(number), point, xytext=tuple(offset), color=colour, **style)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="x / m", ylabel="y / m", title=title)
    ax.margins(0.25)


def _away(point: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The direction `(2,)` in which the edges to the other points `(n, 2)` leave most room."""
    edges = others - point
    length = np.hypot(*edges.T)
    towards = np.sum(edges[length > 0.1] / length[length > 0.1, None], axis=0)
    return -towards / np.hypot(*towards)


def _draw_matrix(ax: Axes, matrix: np.ndarray, title: str) -> None:
    ax.imshow(matrix, cmap="Greys", vmin=0, vmax=4)
    for (i, j), count in np.ndenumerate(matrix):
        ax.text(j, i, str(count), ha="center", va="center", color="white" if count > 2 else "black")
    ax.set_xticks(range(matrix.shape[1]), [str(j + 1) for j in range(matrix.shape[1])])
    ax.set_yticks(range(matrix.shape[0]), [str(i + 1) for i in range(matrix.shape[0])])
    ax.set(xlabel="AP of G_2", ylabel="AP of G_1", title=title)


def main() -> int:
    """Align, print, draw; the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="changes nothing: it takes seconds")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)

    everything, histogram, angles, within, found = jax.device_get(solve(graph(G_1), graph(G_2)))
    everything, within = everything[:, : len(G_2)], within[:, :, : len(G_2)]
    right = int(np.argmax(within.max(axis=(1, 2))))  # of the peak's two rotations
    line, column = np.unravel_index(np.argmax(everything), everything.shape)
    T_found = np.asarray(found.T_ref_query[0], float)
    row = {
        "line": int(line) + 1,
        "column": int(column) + 1,
        "maximum": int(everything.max()),
        "wrong": misled(everything),
        "rotation_deg": round(float(np.degrees(angles[right])), 2),
        "maximum_in_peak": int(within[right].max()),
        "wrong_in_peak": misled(within[right]),
        "x_m": round(T_found[0], 4),
        "y_m": round(T_found[1], 4),
        "theta_deg": round(float(np.degrees(T_found[2])), 3),
        "error_m": round(float(np.hypot(*(T_found - T_1_2)[:2])), 5),
    }
    pairs = correspondences()
    print_table(pairs)
    print_table([row])
    write_table(pairs, arguments.out / "correspondences.csv")
    write_table([row], arguments.out / "worked_example.csv")
    figure = draw(everything, histogram, within[right], T_found)
    write_figure(figure, arguments.out / "worked_example.png")
    write_configuration(arguments.out, G_1=G_1.tolist(), G_2=G_2.tolist(), T_1_2=T_1_2.tolist())
    return 0


if __name__ == "__main__":
    sys.exit(main())
