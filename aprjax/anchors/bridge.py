"""Surfaces that run on across a few beams without a reading.

Not in the paper. Glass, wet and dark surfaces cost single readings; each of them would cut a
surface in two, and its parts would be too small to carry anchors. A beam without return is a
reading: it was free. But many drivers say so of readings that failed, too, and a fine scanner sees
no opening through a beam or two between hits of one surface.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.numerics import running_max, running_min_from_end
from aprjax.scan import Scan


def bridge(
    scan: Scan,
    angle: Float[Array, ""],
    dropout: Float[Array, ""],
    gap: Float[Array, ""],
    spacing: Float[Array, ""],
) -> Scan:
    """The scan with the readings filled in that a surface is short of.

    Beams between two hits at most `angle` radians apart, or `dropout` if one of them had no return,
    get the ranges of the straight line between these, if they lie as close to each other as
    neighbouring hits on one surface must: `gap` + `spacing` min(r, r'). However many beams are
    missing, it allows no more, for readings are often missing at the edges of surfaces.
    """
    slots = scan.ranges.shape[-1]
    index = jnp.arange(slots)
    # Round the back of a full turn: the last reading precedes the first.
    turn = jnp.where(scan.full_turn, scan.beams, 2 * slots)

    def last_before(of: Bool[Array, " slots"]) -> Int[Array, " slots"]:
        found = running_max(jnp.where(of, index, -slots))
        return jnp.where(found < 0, found[-1] - turn, found)

    def first_after(of: Bool[Array, " slots"]) -> Int[Array, " slots"]:
        found = running_min_from_end(jnp.where(of, index, 2 * slots))
        return jnp.where(found >= slots, found[0] + turn, found)

    before, after = last_before(scan.hit), first_after(scan.hit)
    free = (last_before(scan.no_return) > before) | (first_after(scan.no_return) < after)

    near, far = scan.ranges[before % turn], scan.ranges[after % turn]
    between = (after - before).astype(jnp.float32) * scan.angle_increment
    apart = jnp.sqrt((far - near) ** 2 + 4.0 * near * far * jnp.sin(between / 2) ** 2)
    close = apart <= gap + spacing * jnp.minimum(near, far)
    narrow = jnp.abs(between) <= jnp.where(free, dropout, angle)
    missing = scan.real & ~scan.hit & narrow & close

    # Polar equation of a line through both: 1/r = A cos φ + B sin φ.
    from_near = (index - before).astype(jnp.float32) * scan.angle_increment
    inverse = (jnp.sin(between - from_near) / near + jnp.sin(from_near) / far) / jnp.sin(between)
    return eqx.tree_at(lambda s: s.ranges, scan, jnp.where(missing, 1.0 / inverse, scan.ranges))
