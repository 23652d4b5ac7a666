"""The hypotheses of one match, among references whose poses are known."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from aprjax.metrics import world_poses
from aprjax.plot.style import (
    FLOOR,
    REFERENCE,
    add_legend,
    draw_laser,
    draw_poses,
    frame,
    new_axes,
    prepare,
)
from aprjax.references import ReferenceSet
from aprjax.result import MatchResult

_HYPOTHESIS = "#d9480f"
_TICK = 0.55  # metres, for a reference's heading


def draw_answer(
    result: MatchResult, references: ReferenceSet, *, ax: Axes | None = None
) -> list[Artist]:
    """Draw the hypotheses of one query, numbered from 0, in the frame of `references.T_world_ref`.

    References without a known pose, and hypotheses in them, are left out. What the references'
    scans saw is faint. Raises `ValueError` where no pose is known.
    """
    known = np.asarray(np.isfinite(references.T_world_ref).all(axis=1))
    if not known.any():
        raise ValueError("references: no T_world_ref is known")
    T_world_ref = references.T_world_ref[known]
    seen = _seen(references, known)
    answered = np.asarray(result.valid) & np.isin(result.reference, references.ids[known])
    T_world_query = world_poses(result, references.ids, references.T_world_ref)

    around = np.concatenate([seen, T_world_ref[:, :2], T_world_query[answered, :2]])
    ax = new_axes(around) if ax is None else ax
    prepare(ax)
    ax.grid(False)
    # As pixels in a vector file: there are tens of thousands.
    drawn: list[Artist] = [
        *ax.plot(*seen.T, ls="", marker=".", ms=1.5, color=FLOOR, zorder=1, rasterized=True)
    ]
    drawn += draw_poses(
        ax, T_world_ref, REFERENCE, "reference scans", tick=_TICK, size=26, zorder=3
    )
    for rank in np.flatnonzero(answered):
        pose = T_world_query[rank]
        drawn += draw_laser(ax, pose, _HYPOTHESIS, label=None if rank else "hypotheses, numbered")
        beside = {"textcoords": "offset points", "xytext": (7, 5), "fontsize": 9, "zorder": 6}
        drawn.append(ax.annotate(str(rank), (pose[0], pose[1]), color=_HYPOTHESIS, **beside))
    frame(ax, around)
    add_legend(ax)
    return drawn


def _seen(references: ReferenceSet, known: np.ndarray) -> np.ndarray:
    """End points `(points, 2)` of the scans of known pose, in metres in their frame."""
    hit = np.asarray(references.scans.hit)[known]
    xy = np.asarray(references.scans.points, float)[known]
    x, y, theta = references.T_world_ref[known].T[..., None]
    cos, sin = np.cos(theta), np.sin(theta)
    moved = np.stack(
        [x + cos * xy[..., 0] - sin * xy[..., 1], y + sin * xy[..., 0] + cos * xy[..., 1]], axis=-1
    )
    return moved[hit]
