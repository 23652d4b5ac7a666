"""An occupancy grid, and poses in it."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.transforms import Affine2D

from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.plot.style import REFERENCE, add_legend, draw_poses, frame, new_axes, prepare

_UNKNOWN_GREY = 0.8
_RIGHT, _WRONG = "#2a8a3e", "#c1272d"
_TICK = 0.4  # metres, for a pose's heading


def draw_grid(
    grid: OccupancyGrid,
    viewpoints: np.ndarray | None = None,
    *,
    right: np.ndarray | None = None,
    wrong: np.ndarray | None = None,
    ax: Axes | None = None,
) -> list[Artist]:
    """Draw a grid in its world: occupied black, free white, unknown grey.

    `viewpoints` `(N, 2)` in metres are blue points; `right` and `wrong` are poses `(N, 3)` in
    metres and radians, green and red, with a tick along the heading.
    """
    cells = grid.cells.astype(float)
    grey = np.where(cells < 0, _UNKNOWN_GREY, 1 - cells / 100)
    rows, columns = grid.cells.shape
    corners = grid.centres(np.array([[0, 0], [0, columns], [rows, 0], [rows, columns]]))
    ax = new_axes(corners) if ax is None else ax
    prepare(ax)
    ax.grid(False)
    x, y, yaw = grid.T_world_grid
    in_world = Affine2D().scale(grid.resolution).rotate(yaw).translate(x, y)
    picture = ax.imshow(
        grey,
        cmap="gray",
        vmin=0,
        vmax=1,
        origin="lower",
        extent=(0, columns, 0, rows),
        transform=in_world + ax.transData,
        interpolation="none",
    )
    drawn: list[Artist] = [picture]
    if viewpoints is not None:
        label = f"viewpoints ({len(viewpoints)})"
        drawn += ax.plot(
            *viewpoints[:, :2].T, ls="", marker="o", ms=4, color=REFERENCE, label=label
        )
    for poses, colour, name in ((right, _RIGHT, "right"), (wrong, _WRONG, "wrong")):
        if poses is not None:
            drawn += draw_poses(ax, poses, colour, name, tick=_TICK, size=10, zorder=3)
    frame(ax, corners)
    if ax.get_legend_handles_labels()[1]:
        add_legend(ax)
    return drawn
