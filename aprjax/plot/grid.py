"""An occupancy grid, and poses in it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D

from aprjax.grid.occupancy_grid import OccupancyGrid
from aprjax.plot.style import add_legend, figure_of, frame, prepare

_UNKNOWN_GREY = 0.8
_VIEWPOINT, _RIGHT, _WRONG = "#1f5fa8", "#2a8a3e", "#c1272d"
_TICK = 0.4  # metres, for a pose's heading


def draw_grid(
    grid: OccupancyGrid,
    viewpoints: np.ndarray | None = None,
    *,
    right: np.ndarray | None = None,
    wrong: np.ndarray | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw a grid in its world: occupied black, free white, unknown grey.

    `viewpoints` `(N, 2)` in metres are blue points; `right` and `wrong` are poses `(N, 3)` in
    metres and radians, green and red, with a tick along the heading. `ax` defaults to the axes of
    a new figure. Returns the figure, which belongs to no window.
    """
    cells = grid.cells.astype(float)
    grey = np.where(cells < 0, _UNKNOWN_GREY, 1 - cells / 100)
    rows, columns = grid.cells.shape
    corners = grid.centres(np.array([[0, 0], [0, columns], [rows, 0], [rows, columns]]))
    ax = _new_axes(corners) if ax is None else ax
    prepare(ax)
    ax.grid(False)
    x, y, yaw = grid.T_world_grid
    in_world = Affine2D().scale(grid.resolution).rotate(yaw).translate(x, y)
    ax.imshow(
        grey, cmap="gray", vmin=0, vmax=1, origin="lower", extent=(0, columns, 0, rows),
        transform=in_world + ax.transData, interpolation="none",
    )  # fmt: skip
    if viewpoints is not None:
        ax.plot(*viewpoints[:, :2].T, ls="", marker="o", ms=4, color=_VIEWPOINT,
                label=f"viewpoints ({len(viewpoints)})")  # fmt: skip
    for poses, colour, name in ((right, _RIGHT, "right"), (wrong, _WRONG, "wrong")):
        if poses is not None:
            _draw_poses(ax, poses, colour, f"{name} ({len(poses)})")
    frame(ax, corners)
    if ax.get_legend_handles_labels()[1]:
        add_legend(ax)
    return figure_of(ax)


def _new_axes(corners: np.ndarray) -> Axes:
    """Axes of a new figure, 10 inches at its longer side."""
    size = np.ptp(corners, axis=0)
    width, height = np.maximum(10.0 * size / size.max(), 3.0)
    return Figure(figsize=(width + 0.8, height + 1.0), layout="constrained").add_subplot()


def _draw_poses(ax: Axes, poses: np.ndarray, colour: str, label: str) -> None:
    heading = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=-1)
    ticks = np.stack([poses[:, :2], poses[:, :2] + _TICK * heading], axis=1)
    ax.add_collection(LineCollection(list(ticks), colors=colour, linewidths=1.2))
    ax.plot(*poses[:, :2].T, ls="", marker=".", ms=5, color=colour, label=label)
