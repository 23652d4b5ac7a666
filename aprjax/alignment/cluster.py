"""From the edge pairs behind a matrix maximum to one transformation (paper 2.C)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from aprjax.alignment.correspondence import CorrespondenceConfig
from aprjax.configuration import threshold
from aprjax.numerics import safe_arctan2, wrap
from aprjax.relations.graph import AnchorGraph
from aprjax.se2 import Pose, rotate


class ClusterConfig(eqx.Module):
    """Which transformations are similar."""

    distance: Float[Array, ""] = threshold(0.2, "metres, where the query's anchors come to lie")
    angle: Float[Array, ""] = threshold(0.1, "radians")


class Contributions(eqx.Module):
    """Transformations, one for each edge of the reference that starts at the anchor."""

    angle: Float[Array, " n"]
    """Rotation in radians."""
    middle: Float[Array, "n 2"]
    """Where the centre of the query's anchors comes to lie, in metres."""
    valid: Bool[Array, " n"]


def contributions(
    reference: AnchorGraph,
    query: AnchorGraph,
    anchors: tuple[Array, Array],
    rotation: Float[Array, ""],
    centre: Float[Array, "2"],
    config: CorrespondenceConfig,
) -> Contributions:
    """The transformations from the edges at an identified pair of anchors (i, j).

    Of the query's edges that may be edge (i, b) of the reference, the one closest in length is
    taken. Middle point comes on middle point.
    """
    i, j = anchors
    unit, length = reference.unit[i], reference.length[i]
    turned = rotate(query.unit[j], rotation)
    off = jnp.abs(length[:, None] - query.length[j])
    cosine = unit[:, None, 0] * turned[:, 0] + unit[:, None, 1] * turned[:, 1]
    may = (off <= config.length) & (cosine >= jnp.cos(config.angle) - 1e-6)
    may = may & reference.valid[i][:, None] & query.valid[j]
    partner = jnp.argmin(jnp.where(may, off, jnp.inf), axis=1)

    ours = query.unit[j, partner]
    sine = ours[:, 0] * unit[:, 1] - ours[:, 1] * unit[:, 0]
    angle = safe_arctan2(sine, jnp.sum(ours * unit, axis=-1))
    to_centre = centre - 0.5 * (query.xy[j] + query.xy[partner])
    middle = 0.5 * (reference.xy[i] + reference.xy) + rotate(to_centre, angle)
    return Contributions(angle=angle, middle=middle, valid=jnp.any(may, axis=1))


def centre_of_gravity(
    found: Contributions, centre: Float[Array, "2"], config: ClusterConfig
) -> tuple[Pose, Float[Array, ""]]:
    """The mean transformation `T_ref_query` of the largest cluster, and its size.

    The cluster is what lies near the contribution with most neighbours; the others are the
    erroneous ones that the clustering is there to drop.
    """
    gap = jnp.sum((found.middle[:, None] - found.middle) ** 2, axis=-1)
    turn = jnp.abs(wrap(found.angle[:, None] - found.angle))
    near = (gap <= config.distance**2) & (turn <= config.angle) & found.valid & found.valid[:, None]
    seed = jnp.argmax(jnp.sum(near, axis=1))
    member = near[seed].astype(jnp.float32)
    size = jnp.sum(member)
    share = member / jnp.maximum(size, 1.0)
    angle = found.angle[seed] + jnp.sum(share * wrap(found.angle - found.angle[seed]))
    middle = jnp.sum(share[:, None] * found.middle, axis=0)
    xy = middle - rotate(centre, angle)
    return jnp.concatenate([xy, wrap(angle)[None]]), size
