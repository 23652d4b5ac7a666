"""How well anchors and matches do, in NumPy."""

import numpy as np

from aprjax.anchors.candidates import Kind
from aprjax.anchors.extract import Anchors
from aprjax.scan import Scan


def repeatability(
    anchors_a: Anchors,
    anchors_b: Anchors,
    T_a_b: np.ndarray,
    radius: float = 0.1,
    scan_b: Scan | None = None,
) -> float:
    """Share of the anchors of scan a that scan b of the same place has again; NaN if a has none.

    `T_a_b` `(3,)` is the true pose of b's laser in a's frame, in metres and radians, `radius` is
    in metres. See `reappearing` for what is counted.
    """
    counted, found = reappearing(anchors_a, anchors_b, T_a_b, radius, scan_b)
    return float(found.sum() / counted.sum()) if counted.any() else float("nan")


def reappearing(
    anchors_a: Anchors,
    anchors_b: Anchors,
    T_a_b: np.ndarray,
    radius: float = 0.1,
    scan_b: Scan | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Which anchors of a count, and which of those b has again: two masks `(anchors,)`.

    An anchor of a is there again if any anchor of b, moved by `T_a_b`, lies within `radius`
    metres of it; the kinds may differ, for matching does not look at them. Without `scan_b` all
    valid anchors of a count. With it, a jump edge or an angle counts only if b could see it: it
    lies in b's field of view and within its range limit, and at least one of the three beams
    nearest in bearing is not known to end more than 0.2 m before it. Virtual edges always count:
    they lie on no surface, so nothing says where they could be seen from.
    """
    xy_a, valid_a = np.asarray(anchors_a.xy, float), np.asarray(anchors_a.valid)
    xy_b = np.asarray(anchors_b.xy, float)[np.asarray(anchors_b.valid)]
    cos, sin = np.cos(T_a_b[2]), np.sin(T_a_b[2])
    R_a_b = np.array([[cos, -sin], [sin, cos]])

    gap = xy_a[:, None] - (T_a_b[:2] + xy_b @ R_a_b.T)
    near = np.any(np.hypot(gap[..., 0], gap[..., 1]) <= radius, axis=1)
    counted = valid_a
    if scan_b is not None:
        virtual = np.asarray(anchors_a.kind) == Kind.VIRTUAL_EDGE
        counted = valid_a & (virtual | _visible((xy_a - T_a_b[:2]) @ R_a_b, scan_b))
    return counted, counted & near


def _visible(xy: np.ndarray, scan: Scan, margin: float = 0.2) -> np.ndarray:
    """Which points `(points, 2)`, in metres in the laser's frame, a scan could have seen."""
    distance = np.hypot(xy[:, 0], xy[:, 1])
    step, beams = float(scan.angle_increment), int(scan.beams)
    past = (np.arctan2(xy[:, 1], xy[:, 0]) - float(scan.angle_min)) * np.sign(step)
    # Half a beam before the first one is still in view.
    nearest = np.round(np.mod(past + 0.5 * abs(step), 2 * np.pi) / abs(step) - 0.5).astype(int)
    ends = np.where(np.asarray(scan.hit), np.asarray(scan.ranges, float), np.inf)[:beams]
    three = nearest[:, None] + np.array([-1, 0, 1])
    three = three % beams if bool(scan.full_turn) else np.clip(three, 0, beams - 1)
    open_ = np.any(ends[three] > distance[:, None] - margin, axis=1)
    return (nearest < beams) & (distance <= float(scan.range_max)) & open_
