"""Iterative dual correspondence: a scan's pose in a reference scan's frame, from a start near it.

Lu and Milios, Robot Pose Estimation in Unknown Environments by Matching 2D Range Scans, J. of
Intelligent and Robotic Systems 18, 1997. In each step every end point of the query is paired
twice with the reference's surface: with its closest point, which tells the translation, and with
the point of its own range nearby in bearing, which tells the rotation. Closest points alone turn
a scan slowly, for they slide along the walls; a point that turns about the laser keeps its range.

Four things differ from the article. Where it drops a fixed share of the worst pairs, Tukey's
weight with a shrinking gate does. The reference's points are paired with the query's surface too.
Where it finds the rotation first by a search over tangents, the steps start from several headings
and the one that ends with the scans closest is taken. At last one solve from points to lines,
`refine.estimate`, which also tells the covariance.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.view import View
from aprjax.numerics import arctan2, dot, safe_norm, single_precision, total, wrap
from aprjax.refine import RefineConfig, estimate
from aprjax.se2 import Pose, inverse, rotate, transform

_NOTHING = 1e6  # square metres between what is not paired
_FEWEST = 3.0  # pairs of full weight that move a scan


class IdcConfig(eqx.Module):
    """How far pairs may lie apart, how that shrinks, and when a pose counts as found."""

    gate: Float[Array, ""] = threshold(0.8, "metres that paired points may lie apart at first")
    final_gate: Float[Array, ""] = threshold(0.2, "metres at last")
    window: Float[Array, ""] = threshold(0.15, "radians of bearing searched for a range at first")
    final_window: Float[Array, ""] = threshold(0.03, "radians at last")
    nearness: Float[Array, ""] = threshold(
        0.15, "metres off its range that a point weighs as much as a metre of arc"
    )
    spread: Float[Array, ""] = threshold(0.2, "radians from the start to the outermost heading")
    cap: Float[Array, ""] = threshold(0.3, "metres beyond which scans are no worse apart")
    still: Float[Array, ""] = threshold(0.1, "metres and radians that the last solve may move")
    min_paired: Float[Array, ""] = threshold(0.5, "share of hits on the other's surface when found")
    points: int = capacity(64, "most end points of a scan that are paired")
    headings: int = capacity(3, "headings to start from")
    iterations: int = capacity(16, "steps from each")
    last: RefineConfig = RefineConfig()


class Idc(eqx.Module):
    """What iterative dual correspondence found."""

    T_ref_query: Pose
    """Metres and radians."""
    covariance: Float[Array, "*batch 3 3"]
    """m², m rad, rad²: long in a direction in which no surface holds the query."""
    residual: Float[Array, "*batch"]
    """Metres: root mean square of what paired hits lie off the other scan's surface."""
    paired: Float[Array, "*batch"]
    """Share of the hits within the final gate of the other's surface; the scan with fewer."""
    converged: Bool[Array, "*batch"]
    """Whether enough hits are paired and points and lines agree on the pose."""


class _Surface(eqx.Module):
    """A scan's surface in pieces from each hit to the next one on it; a lone hit is a point."""

    start: Float[Array, "pieces 2"]
    along: Float[Array, "pieces 2"]
    real: Bool[Array, " pieces"]


class _Points(eqx.Module):
    """Some of a scan's end points."""

    xy: Float[Array, "points 2"]
    real: Bool[Array, " points"]


@single_precision()
def idc(
    references: View,
    queries: View,
    T_ref_query: Float[Array | np.ndarray, "pairs 3"],
    config: IdcConfig,
) -> Idc:
    """The pose of each query in the frame of its reference, from the starts `T_ref_query`.

    Views are stacked, pair by pair; `ReferenceSet.index.features.view` holds those of references.
    From 0.3 m and 10° off it finds most poses of scans that share half of what they see. Never
    raises: a scan without hits is not converged.
    """
    return _idc(references, queries, T_ref_query, config)


@jax.jit
def _idc(
    references: View, queries: View, T_ref_query: Float[Array, "pairs 3"], config: IdcConfig
) -> Idc:
    return jax.vmap(correspond, (0, 0, 0, None))(references, queries, T_ref_query, config)


def correspond(reference: View, query: View, T_ref_query: Pose, config: IdcConfig) -> Idc:
    """`idc` of one pair of views, from a start `(3,)`. Pure and traceable."""
    surfaces = _surface(reference), _surface(query)
    points = _points(reference, config.points), _points(query, config.points)
    offsets = config.spread * np.linspace(-1.0, 1.0, config.headings, dtype=np.float32)
    if config.headings == 1:
        offsets = jnp.zeros(1)
    starts = T_ref_query[None] + offsets[:, None] * np.array([[0, 0, 1]], np.float32)

    ends = jax.vmap(lambda start: _descend(surfaces, points, start, config))(starts)
    apart = jax.vmap(lambda end: _apart(surfaces, points, end, config)[0])(ends)
    end = ends[jnp.argmin(apart)]
    refined = estimate(reference, query, end, config.last)
    _, paired, residual = _apart(surfaces, points, refined.T_ref_query, config)
    step = refined.T_ref_query - end
    moved = jnp.maximum(safe_norm(step[:2]), jnp.abs(wrap(step[2])))
    found = (paired >= config.min_paired) & (moved <= config.still)
    return Idc(refined.T_ref_query, refined.covariance, residual, paired, found)


def _descend(
    surfaces: tuple[_Surface, _Surface],
    points: tuple[_Points, _Points],
    T_ref_query: Pose,
    config: IdcConfig,
) -> Pose:
    """The pose after all steps from one start. Gate and window shrink exponentially."""

    def step(T_ref_query: Pose, cooled: Float[Array, ""]) -> tuple[Pose, None]:
        gate = config.gate * (config.final_gate / config.gate) ** cooled
        window = config.window * (config.final_window / config.window) ** cooled
        return _step(surfaces, points, T_ref_query, gate, window, config), None

    cooled = jnp.linspace(0.0, 1.0, config.iterations)
    return jax.lax.scan(step, T_ref_query, cooled)[0]


def _step(
    surfaces: tuple[_Surface, _Surface],
    points: tuple[_Points, _Points],
    T_ref_query: Pose,
    gate: Float[Array, ""],
    window: Float[Array, ""],
    config: IdcConfig,
) -> Pose:
    """One step: the translation that closest points tell, the rotation that ranges tell."""
    laser = T_ref_query[None, :2]
    arm = rotate(points[1].xy, T_ref_query[2][None])
    closest, gap = _closest(surfaces[0], arm + laser)
    ranged, range_gap = _same_range(surfaces[0], arm + laser, window, config.nearness)
    # The other way about, the closest points of the query move and the reference's stay.
    T_query_ref = inverse(T_ref_query)
    back, back_gap = _closest(surfaces[1], transform(T_query_ref, points[0].xy))
    _, shift = _rigid(
        jnp.concatenate([arm, rotate(back, T_ref_query[2][None])]),
        jnp.concatenate([closest, points[0].xy]) - laser,
        jnp.concatenate(
            [_weight(gap, gate, points[1].real), _weight(back_gap, gate, points[0].real)]
        ),
    )
    turn, _ = _rigid(arm, ranged - laser, _weight(range_gap, gate, points[1].real))
    return jnp.concatenate([T_ref_query[:2] + shift, wrap(T_ref_query[2:] + turn[None])])


def _apart(
    surfaces: tuple[_Surface, _Surface],
    points: tuple[_Points, _Points],
    T_ref_query: Pose,
    config: IdcConfig,
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """How badly two scans lie on each other, the share of paired hits, and their residual."""
    gaps = (
        _closest(surfaces[1], transform(inverse(T_ref_query), points[0].xy))[1],
        _closest(surfaces[0], transform(T_ref_query, points[1].xy))[1],
    )
    capped, paired, square, near = [], [], [], []
    for gap, real in zip(gaps, (points[0].real, points[1].real), strict=True):
        hits = jnp.maximum(jnp.sum(real, dtype=jnp.float32), 1.0)
        close = real & (gap <= config.final_gate)
        off = jnp.where(real, jnp.minimum(gap / config.cap, 1.0), 0.0)
        capped.append(total(off * off) / hits)
        near.append(jnp.sum(close, dtype=jnp.float32))
        paired.append(near[-1] / hits)
        square.append(total(jnp.where(close, gap * gap, 0.0)))
    residual = jnp.sqrt((square[0] + square[1]) / jnp.maximum(near[0] + near[1], 1.0))
    return capped[0] + capped[1], jnp.minimum(paired[0], paired[1]), residual


def _surface(view: View) -> _Surface:
    following = jnp.concatenate([view.xy[1:], view.xy[:1]])
    return _Surface(view.xy, jnp.where(view.linked[:, None], following - view.xy, 0.0), view.hit)


def _points(view: View, size: int) -> _Points:
    beam, real = view.thin(size)
    return _Points(view.xy[beam], real & view.hit[beam])


def _closest(
    surface: _Surface, xy: Float[Array, "points 2"]
) -> tuple[Float[Array, "points 2"], Float[Array, " points"]]:
    """The surface's point closest to each of the points, and the metres between them."""
    square = dot(surface.along, surface.along)
    per_square = jnp.where(square > 0, 1.0 / jnp.where(square > 0, square, 1.0), 0.0)
    rows = (surface.start, surface.along, per_square, jnp.where(surface.real, 0.0, _NOTHING))

    def nearer(best, row):
        start, along, per_square, unreal = row
        dx, dy = xy[:, 0] - start[0], xy[:, 1] - start[1]
        share = jnp.clip((dx * along[0] + dy * along[1]) * per_square, 0.0, 1.0)
        dx, dy = dx - share * along[0], dy - share * along[1]
        here = dx * dx + dy * dy + unreal, dx, dy
        return _better(here, best), None

    square, off = _search(nearer, xy, rows)
    return xy - off, jnp.sqrt(square)


def _same_range(
    surface: _Surface,
    xy: Float[Array, "points 2"],
    window: Float[Array, ""],
    nearness: Float[Array, ""],
) -> tuple[Float[Array, "points 2"], Float[Array, " points"]]:
    """The surface's point within `window` radians that has most nearly the range of each point.

    And by how many metres its range differs, though a wall has one for a whole window: of points
    about as good, the one nearest in bearing. Along a piece, the range is taken to change evenly.
    """
    r = safe_norm(xy)
    near = safe_norm(surface.start)
    longer = safe_norm(surface.start + surface.along) - near
    sloped = jnp.abs(longer) > 1e-4
    per_metre = jnp.where(sloped, 1.0 / jnp.where(sloped, longer, 1.0), 0.0)
    reach = 4.0 * jnp.sin(0.5 * window) ** 2 * r
    unreal = jnp.where(surface.real, 0.0, _NOTHING)
    rows = (surface.start, surface.along, near, longer, per_metre, unreal)

    def nearer(best, row):
        start, along, near, longer, per_metre, unreal = row
        share = jnp.clip((r - near) * per_metre, 0.0, 1.0)
        found = near + share * longer
        dx = xy[:, 0] - start[0] - share * along[0]
        dy = xy[:, 1] - start[1] - share * along[1]
        # By the law of cosines: the square of the chord, as if both ranges were the same.
        square = (found - r) ** 2
        chord = jnp.maximum(dx * dx + dy * dy - square, 0.0)
        outside = jnp.where(chord > reach * found, _NOTHING, 0.0)
        here = square + nearness**2 * chord + unreal + outside, dx, dy
        return _better(here, best), None

    cost, off = _search(nearer, xy, rows)
    partner = xy - off
    return partner, jnp.where(cost < _NOTHING, jnp.abs(safe_norm(partner) - r), jnp.inf)


def _search(nearer, xy, rows):
    """Piece after piece over all points: on a CPU, XLA vectorises this, and not an argmin."""
    nothing = jnp.full_like(xy[:, 0], _NOTHING), jnp.zeros_like(xy[:, 0]), jnp.zeros_like(xy[:, 0])
    (cost, dx, dy), _ = jax.lax.scan(nearer, nothing, rows, unroll=2)
    return cost, jnp.stack([dx, dy], axis=-1)


def _better(here, best):
    """Point by point, whichever costs less; what was found first in a tie."""
    return tuple(
        jnp.where(here[0] < best[0], new, old) for new, old in zip(here, best, strict=True)
    )


def _weight(
    gap: Float[Array, " points"], gate: Float[Array, ""], real: Bool[Array, " points"]
) -> Float[Array, " points"]:
    """Tukey's weight."""
    share = jnp.minimum(gap / gate, 1.0)
    return jnp.where(real, (1.0 - share**2) ** 2, 0.0)


def _rigid(
    start: Float[Array, "pairs 2"], goal: Float[Array, "pairs 2"], weight: Float[Array, " pairs"]
) -> tuple[Float[Array, ""], Float[Array, "2"]]:
    """The turn about the origin, and the shift after it, of least squares; zero for few pairs."""
    weights = total(weight)
    enough = weights > _FEWEST
    size = jnp.where(enough, weights, 1.0)
    start_mean, goal_mean = (total(weight[None] * xy.T) / size for xy in (start, goal))
    a, b = start - start_mean[None], goal - goal_mean[None]
    sin = total(weight * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    turn = arctan2(sin, total(weight * dot(a, b)))
    shift = goal_mean - rotate(start_mean, turn)
    return jnp.where(enough, turn, 0.0), jnp.where(enough, shift, 0.0)
