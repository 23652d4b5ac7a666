"""The paper's alignment of two anchor graphs (2.C, Fig. 2), in two pictures."""

import jax
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aprjax.alignment.correspondence import CorrespondenceConfig, correspondence_matrices
from aprjax.alignment.rotation import RotationConfig, rotation_peaks
from aprjax.numerics import single_precision
from aprjax.relations.graph import AnchorGraph
from aprjax.relations.histograms import RelationConfig, direction_spectrum, matching_angles

_BARS, _PEAK = "#9aa7b5", "#c1272d"


@jax.jit
def _matching_angles(reference: AnchorGraph, query: AnchorGraph, config: RelationConfig):
    ours, theirs = (direction_spectrum(graph, config)[None] for graph in (query, reference))
    return matching_angles(ours, theirs, config)[0, 0]


_peaks = jax.jit(rotation_peaks, static_argnames="config")
_matrices = jax.jit(correspondence_matrices)


@single_precision()
def draw_matching_angles(
    reference: AnchorGraph,
    query: AnchorGraph,
    relation: RelationConfig | None = None,
    rotation: RotationConfig | None = None,
    *,
    ax: Axes | None = None,
) -> list[Artist]:
    """Draw the matching angle histogram of two graphs, and the rotations that its peaks stand for.

    Each bar counts the pairs of edges of corresponding length that would coincide after turning
    the query by this angle, modulo half a turn.
    """
    histogram = _matching_angles(reference, query, relation or RelationConfig())
    peaks = _peaks(histogram, rotation or RotationConfig())
    histogram, votes = np.asarray(histogram), np.asarray(peaks.votes)
    ax = _new_axes() if ax is None else ax
    width = 180.0 / len(histogram)
    bars = ax.bar(width * np.arange(len(histogram)), histogram, width, color=_BARS, align="edge")
    drawn: list[Artist] = [*bars]
    half = len(votes) // 2  # the other half are the same peaks, half a turn on
    angles = np.degrees(np.asarray(peaks.angle)[:half][votes[:half] > 0]) % 180.0
    for number, angle in enumerate(angles):
        label = None if number else "peaks: rotations, or half a turn more"
        drawn.append(ax.axvline(angle, color=_PEAK, linewidth=1.2, label=label))
    ax.set(xlim=(0, 180), xlabel="rotation of the query / °, modulo 180°", ylabel="pairs of edges")
    ax.set_title(f"{int(histogram.sum())} pairs of edges of corresponding length", fontsize=10)
    if len(angles):
        ax.legend(fontsize=8, loc="upper right")
    return drawn


@single_precision()
def draw_correspondences(
    reference: AnchorGraph,
    query: AnchorGraph,
    angle: float,
    config: CorrespondenceConfig | None = None,
    *,
    ax: Axes | None = None,
) -> list[Artist]:
    """Draw the anchor point correspondence matrix of two graphs for one rotation in radians.

    Row i and column j tell how often anchor i of the reference was identified with anchor j of the
    query. Anchors without an edge, such as padding, are left out.
    """
    rotations = np.asarray([angle], np.float32)
    matrix = np.asarray(_matrices(reference, query, rotations, config or CorrespondenceConfig()))[0]
    rows, columns = (
        np.flatnonzero(np.asarray(graph.valid).any(axis=1)) for graph in (reference, query)
    )
    ax = _new_axes(square=True) if ax is None else ax
    shown = matrix[np.ix_(rows, columns)]
    # Also of no anchors there is a picture, an empty one.
    right, bottom = max(len(columns), 1) - 0.5, max(len(rows), 1) - 0.5
    picture = ax.imshow(
        shown, cmap="Blues", vmin=0, vmax=max(matrix.max(), 1), extent=(-0.5, right, bottom, -0.5)
    )
    drawn: list[Artist] = [picture]
    for (i, j), count in np.ndenumerate(shown):
        colour = "white" if count > 0.6 * matrix.max() else "black"
        style = {"ha": "center", "va": "center", "fontsize": 7, "color": colour}
        drawn.append(ax.text(j, i, str(count) if count else "", **style))
    ax.set_xticks(range(len(columns)), [str(j) for j in columns], fontsize=7)
    ax.set_yticks(range(len(rows)), [str(i) for i in rows], fontsize=7)
    ax.set(xlabel="anchor of the query", ylabel="anchor of the reference")
    ax.set_title(f"rotation {np.degrees(angle):.0f}°: identifications", fontsize=10)
    return drawn


def _new_axes(*, square: bool = False) -> Axes:
    size = (5.5, 5.5) if square else (7.0, 3.5)
    return Figure(figsize=size, layout="constrained").add_subplot()
