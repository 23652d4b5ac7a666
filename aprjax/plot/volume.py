"""The paper's Fig. 5: position hypotheses as volumes of a local configuration space."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from aprjax.plane import compose, wrap
from aprjax.tracking.hypothesis import Hypothesis

_COLOUR = "#1f5fa8"
_CORNERS = 48  # of the polygon that a disc is drawn as
_FAINT, _DENSE = 0.05, 0.22  # how opaque a volume of λ_i = 0 is, and one of 1


def draw_volumes(
    T_node_home: Mapping[int, np.ndarray],
    hypotheses: Sequence[Hypothesis],
    *,
    middle: float = 0.0,
    colour: str = _COLOUR,
    named: bool = False,
    ax: Axes3D | None = None,
) -> list[Artist]:
    """Draw the volumes V_i of hypotheses in the local configuration space of a node (paper 4.A).

    Along the axes are x and y in metres in the node's frame, and the heading θ in degrees. A volume
    is a cylinder about its centre c_i, the dot: the line to its side is r_i long, the one along
    its axis Δ_i up and down; the more opaque, the larger λ_i. `named` writes these symbols
    there.

    `T_node_home` has the poses `(3,)`, in metres and radians, of the hypotheses' home nodes in the
    node's frame; hypotheses of nodes that it does not hold are left out. `{node: np.zeros(3)}`
    leaves those of the node itself, and `aprjax.world.super_space.assemble(world, node)` carries
    over those of others, along the arcs. A turn has no ends: headings are drawn within half a one
    of `middle` radians. `ax` has the projection "3d".
    """
    first = ax is None or not ax.has_data()
    if ax is None:
        ax = Figure(figsize=(7.0, 6.0)).add_subplot(projection="3d")
    drawn: list[Artist] = []
    corners = [] if first else [np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()]).T]
    for hypothesis in hypotheses:
        home = hypothesis.place.node
        if home in T_node_home:
            centre = in_degrees(compose(T_node_home[home], hypothesis.place.T_node_laser), middle)
            drawn += _draw_volume(ax, centre, hypothesis, colour)
            if named:
                drawn += _name(ax, centre, hypothesis)
            corners += [centre - _extent(hypothesis), centre + _extent(hypothesis)]
    ax.set(xlabel="x / m", ylabel="y / m", zlabel="θ / °")
    if corners:
        show_box(ax, np.min(np.vstack(corners), axis=0), np.max(np.vstack(corners), axis=0))
    return drawn


def show_box(ax: Axes3D, low: np.ndarray, high: np.ndarray) -> None:
    """Show what lies between two corners `(3,)` in metres and degrees, x and y with one scale."""
    middle, half = (low + high) / 2, (high - low) / 2
    half[:2] = half[:2].max()
    ax.set_box_aspect((1.0, 1.0, 0.8))
    ax.set_xlim(middle[0] - half[0], middle[0] + half[0])
    ax.set_ylim(middle[1] - half[1], middle[1] + half[1])
    ax.set_zlim(middle[2] - half[2], middle[2] + half[2])


def in_degrees(T_node_laser: np.ndarray, middle: float = 0.0) -> np.ndarray:
    """Points `(..., 3)` of the axes of `draw_volumes` for poses `(..., 3)` in metres and radians.

    Headings become degrees within half a turn of `middle` radians.
    """
    heading = np.degrees(middle + wrap(T_node_laser[..., 2] - middle))
    return np.concatenate([T_node_laser[..., :2], heading[..., None]], axis=-1)


def _extent(hypothesis: Hypothesis) -> np.ndarray:
    """From the centre to the sides and the top: metres, metres, degrees."""
    return np.array([hypothesis.radius, hypothesis.radius, np.degrees(hypothesis.angle)])


def _draw_volume(
    ax: Axes3D, centre: np.ndarray, hypothesis: Hypothesis, colour: str
) -> list[Artist]:
    turn = np.linspace(0.0, 2 * np.pi, _CORNERS + 1)
    disc = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)
    up = _extent(hypothesis) * [0.0, 0.0, 1.0]
    rim = centre + hypothesis.radius * disc
    low, high = rim - up, rim + up
    sides = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
    alpha = _FAINT + (_DENSE - _FAINT) * hypothesis.probability
    filled = {"facecolors": colour, "edgecolors": "none", "alpha": alpha}
    spokes = [np.array([centre, rim[_CORNERS // 2]]), np.array([centre - up, centre + up])]
    edges = Line3DCollection([low, high, *spokes], colors=colour, linewidths=1.0)
    # The limits are set by hand: matplotlib's take the origin in where polygons are not alike.
    return [
        ax.add_collection3d(Poly3DCollection([*sides, low, high], **filled), autolim=False),
        ax.add_collection3d(edges, autolim=False),
        *ax.plot(*centre[:, None], "o", color=colour, markersize=4),
    ]


def _name(ax: Axes3D, centre: np.ndarray, hypothesis: Hypothesis) -> list[Artist]:
    """The symbols at what they mean."""
    side, up = _extent(hypothesis) * [-0.5, 0.0, 0.0], _extent(hypothesis) * [0.0, 0.0, 0.6]
    return [
        ax.text(x, y, z, symbol, ha=ha, va=va, fontsize=11, zorder=10)
        for (x, y, z), symbol, ha, va in (
            (centre, "$c_i$ ", "right", "top"),
            (centre + side, "$r_i$", "center", "bottom"),
            (centre + up, " $\\Delta_i$", "left", "center"),
        )
    ]
