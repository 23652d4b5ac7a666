"""The paper's Fig. 7: position hypotheses over the assembled map."""

import io

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from aprjax.plane import compose, transform
from aprjax.plot.style import add_legend
from aprjax.plot.world import draw_world, new_world_axes
from aprjax.tracking.belief import Belief
from aprjax.world.model import WorldModel

_HYPOTHESIS = "#000000"
_SIZE = 0.012  # of the map's extent: how long a triangle is
# Forward and left: a triangle, its tip ahead.
_TRIANGLE = np.array([[1.3, 0.0], [-0.7, 0.7], [-0.7, -0.7]])


def draw_hypotheses(
    world: WorldModel,
    T_root_node: dict[int, np.ndarray],
    belief: Belief,
    title: str = "",
    *,
    ax: Axes | None = None,
) -> list[Artist]:
    """Draw a belief over the map in an assembled frame, poses `(3,)` in metres and radians.

    Hypotheses are triangles that point ahead, a circle marks the strongest, λ_b and λ_0 are
    written above. Hypotheses in nodes that the frame does not hold are left out.
    """
    ax = new_world_axes(world, T_root_node) if ax is None else ax
    drawn = draw_world(world, T_root_node, ax=ax)
    size = _SIZE * max(abs(np.diff(ax.get_xlim())[0]), abs(np.diff(ax.get_ylim())[0]))
    poses = [
        compose(T_root_node[h.place.node], h.place.T_node_laser)
        for h in belief.hypotheses
        if h.place.node in T_root_node
    ]
    triangles = [_triangle(pose, size) for pose in poses]
    drawn.append(ax.add_collection(PolyCollection(triangles, facecolors=_HYPOTHESIS, zorder=11)))
    best = belief.best
    if best is not None and best.place.node in T_root_node:
        # The strongest comes first.
        circle = ax.scatter(
            *poses[0][:2],
            s=320,
            facecolors="none",
            edgecolors=_HYPOTHESIS,
            linewidths=1.8,
            label="the strongest",
            zorder=12,
        )
        drawn.append(circle)
    ahead = {"marker": (3, 0, -90), "ls": "", "color": _HYPOTHESIS}
    drawn += ax.plot([], [], label=f"hypotheses ({len(poses)}), pointing ahead", **ahead)
    add_legend(ax)
    strongest = 0.0 if best is None else best.probability
    text = f"{title}  $\\lambda_b$ = {strongest:.2f}   $\\lambda_0$ = {belief.rest:.2f}".strip()
    place = {"transform": ax.transAxes, "ha": "center", "va": "top", "fontsize": 13, "zorder": 13}
    drawn.append(ax.text(0.5, 0.985, text, **place))
    return drawn


def picture_of(figure: Figure, dpi: int) -> Image.Image:
    """A figure as a picture of 64 colours, such as films are made of."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return Image.open(buffer).convert("RGB").quantize(64)


def _triangle(pose: np.ndarray, size: float) -> np.ndarray:
    return transform(pose, size * _TRIANGLE)
