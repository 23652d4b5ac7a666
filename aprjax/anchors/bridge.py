"""Surfaces that run on across a few beams without a reading.

Not in the paper. Glass, wet and dark surfaces cost single readings; each of them would cut a
surface in two, and its parts would be too small to carry anchors. A beam without return is a
reading: it was free.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from aprjax.numerics import running_max, running_min_from_end
from aprjax.scan import Scan


def bridge(
    scan: Scan, angle: Float[Array, ""], gap: Float[Array, ""], spacing: Float[Array, ""]
) -> Scan:
    """The scan with the readings filled in that a surface is short of.

    Invalid beams between two hits at most `angle` radians apart get the ranges of the straight
    line between these, if they lie as close to each other as neighbouring hits on one surface
    must: `gap` + `spacing` min(r, r'). However many beams are missing, it allows no more, for
    readings are often missing at the edges of surfaces.
    """
    slots = scan.ranges.shape[-1]
    index = jnp.arange(slots)
    known = scan.hit | scan.no_return
    before = running_max(jnp.where(known, index, -slots))
    after = running_min_from_end(jnp.where(known, index, 2 * slots))
    # Round the back of a full turn: the last reading precedes the first.
    turn = jnp.where(scan.full_turn, scan.beams, 2 * slots)
    before = jnp.where(before < 0, before[-1] - turn, before)
    after = jnp.where(after >= slots, after[0] + turn, after)

    near, far = scan.ranges[before % turn], scan.ranges[after % turn]  # infinite: not close
    between = (after - before).astype(jnp.float32) * scan.angle_increment
    apart = jnp.sqrt((far - near) ** 2 + 4.0 * near * far * jnp.sin(between / 2) ** 2)
    close = apart <= gap + spacing * jnp.minimum(near, far)
    missing = scan.real & ~known & (jnp.abs(between) <= angle) & close

    # Polar equation of a line through both: 1/r = A cos φ + B sin φ.
    from_near = (index - before).astype(jnp.float32) * scan.angle_increment
    inverse = (jnp.sin(between - from_near) / near + jnp.sin(from_near) / far) / jnp.sin(between)
    return eqx.tree_at(lambda s: s.ranges, scan, jnp.where(missing, 1.0 / inverse, scan.ranges))
