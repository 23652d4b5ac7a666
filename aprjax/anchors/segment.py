"""Segmentation of a scan into connected parts, and removal of the small ones (paper 2.A).

Chair and table legs, waste baskets and people's feet come and go; anchors are searched on
large connected parts only.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.anchors.bridge import bridge
from aprjax.configuration import threshold
from aprjax.numerics import running_max, running_min_from_end, safe_norm
from aprjax.scan import Scan


class SegmentConfig(eqx.Module):
    """When neighbouring hits belong together, and which parts are large."""

    gap: Float[Array, ""] = threshold(0.12, "metres that neighbouring hits may always lie apart")
    incidence: Float[Array, ""] = threshold(
        0.14,
        "radians: shallowest angle between beam and surface at which it stays connected",
        least=0.001,
        most=np.pi / 2,
    )
    bridge: Float[Array, ""] = threshold(
        0.075, "radians between two hits that a surface may run on across", most=np.pi / 2
    )
    dropout: Float[Array, ""] = threshold(
        0.028,
        "radians, likewise, if a beam between them had no return: failed readings are called so",
        most=np.pi / 2,
    )
    min_extent: Float[Array, ""] = threshold(0.2, "metres from its first to its farthest point")
    min_beams: Float[Array, ""] = threshold(3, "hits in a large part")


class Segments(eqx.Module):
    """The beams of one scan in the order of the sweep, and the connected part each lies in.

    A full turn is unrolled at a discontinuity, so that no part crosses the ends of the arrays.
    """

    beam: Int[Array, " slots"]
    """Which slot of the scan each entry is."""
    xy: Float[Array, "slots 2"]
    """Hit points in metres, zero where there is none."""
    range: Float[Array, " slots"]
    """Metres; infinite for no return, zero where nothing is known."""
    hit: Bool[Array, " slots"]
    """Beams that ended on a surface, and those that `bridge` filled in."""
    before: Int[Array, " slots"]
    """How many beams of the same part precede."""
    after: Int[Array, " slots"]
    """How many beams of the same part follow."""
    large: Bool[Array, " slots"]
    """Whether the part is large enough to carry anchors."""
    previous: Int[Array, " slots"]
    """Entry of the neighbouring beam; the entry itself at the end of the field of view."""
    next: Int[Array, " slots"]
    """Likewise on the other side."""
    range_max: Float[Array, ""]
    """Metres that a beam without return is known to be free."""
    angle_min: Float[Array, ""]
    """Bearing of the first entry in radians."""
    angle_increment: Float[Array, ""]
    """Radians to the next entry."""


def segment(scan: Scan, config: SegmentConfig) -> Segments:
    """Connected parts of one scan with `slots` beam slots.

    Neighbouring hits at ranges r and r' are connected when they lie no farther apart than a
    surface at the `incidence` angle would put them, plus `gap`; at grazing incidence consecutive
    hits on one wall lie far apart.
    """
    spacing = _spacing(scan, config)
    scan = bridge(scan, config.bridge, config.dropout, config.gap, spacing)
    slots = scan.ranges.shape[-1]
    index = jnp.arange(slots)
    apart = config.gap + spacing * jnp.where(scan.hit, scan.ranges, 0.0)
    wrapped = jnp.where(index + 1 < scan.beams, index + 1, 0)
    has_next = scan.real & ((index + 1 < scan.beams) | scan.full_turn)
    linked = _linked(scan.points, scan.hit, apart, wrapped) & has_next

    # Unroll after the first break; a closed room has none, and is cut where the surface is
    # straightest over a few beams to each side: on a face, not at a corner.
    cut = _straightest(scan)
    first = jnp.where(jnp.all(linked | ~scan.real), cut, wrapped[jnp.argmax(~linked & scan.real)])
    turned = jnp.where(index + first < scan.beams, index + first, index + first - scan.beams)
    beam = jnp.where(scan.full_turn & scan.real, turned, index)

    hit, xy = scan.hit[beam], scan.points[beam]
    connected = linked[beam] & (index + 1 < scan.beams)
    opens = ~jnp.concatenate([jnp.zeros(1, bool), connected[:-1]])
    start = running_max(jnp.where(opens, index, 0))
    stop = running_min_from_end(jnp.where(connected, slots - 1, index))

    reach = safe_norm(xy - xy[start])
    extent = jax.ops.segment_max(reach, start, num_segments=slots)[start]
    hits = (stop - start + 1).astype(jnp.float32)
    enough = (extent >= config.min_extent) & (hits >= config.min_beams)

    last = jnp.where(scan.full_turn, scan.beams - 1, 0)
    return Segments(
        beam=beam,
        xy=xy,
        range=jnp.where(hit, scan.ranges[beam], jnp.where(scan.no_return[beam], jnp.inf, 0.0)),
        hit=hit,
        before=index - start,
        after=stop - index,
        large=hit & enough,
        previous=jnp.where(index > 0, index - 1, last),
        next=jnp.where(index + 1 < scan.beams, index + 1, jnp.where(scan.full_turn, 0, index)),
        range_max=scan.range_max,
        angle_min=scan.angle_min + beam[0].astype(jnp.float32) * scan.angle_increment,
        angle_increment=scan.angle_increment * jnp.ones(()),
    )


def _straightest(scan: Scan) -> Int[Array, ""]:
    """The hit of a full turn beside which its neighbours bend least."""
    beams = jnp.maximum(scan.beams, 1)
    index = jnp.arange(scan.ranges.shape[-1])
    reach = beams // 36
    ahead = scan.points[(index + reach) % beams] - scan.points
    behind = scan.points - scan.points[(index - reach) % beams]
    cross = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
    bend = jnp.abs(cross) / jnp.maximum(safe_norm(ahead) * safe_norm(behind), 1e-6)
    return jnp.argmin(jnp.where(scan.hit, bend, jnp.inf))


def _spacing(scan: Scan, config: SegmentConfig) -> Float[Array, ""]:
    """Distance of consecutive hits per metre of range on a surface at the `incidence` angle.

    Borges and Aldon's adaptive breakpoint detector (Journal of Intelligent and Robotic Systems
    40, 2004): sin(Δφ) / sin(λ - Δφ), with the angle kept off the pole of coarse scanners.
    """
    step = jnp.abs(scan.angle_increment)
    return jnp.sin(step) / jnp.sin(jnp.maximum(config.incidence - step, 0.5 * config.incidence))


def _linked(
    xy: Float[Array, "slots 2"],
    hit: Bool[Array, " slots"],
    apart: Float[Array, " slots"],
    neighbour: Int[Array, " slots"],
) -> Bool[Array, " slots"]:
    """Whether each hit and its neighbour are both hits and close; the nearer range decides."""
    close = safe_norm(xy[neighbour] - xy) <= jnp.minimum(apart, apart[neighbour])
    return hit & hit[neighbour] & close
