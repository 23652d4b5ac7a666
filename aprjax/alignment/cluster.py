"""From the edge pairs behind a matrix maximum to one transformation (paper 2.C)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.alignment.correspondence import CorrespondenceConfig
from aprjax.configuration import threshold
from aprjax.numerics import arctan2, dot, square_gaps, wrap
from aprjax.relations.graph import AnchorGraph
from aprjax.se2 import Pose, rotate


class ClusterConfig(eqx.Module):
    """Which transformations are similar."""

    distance: Float[Array, ""] = threshold(0.2, "metres, where the query's anchors come to lie")
    angle: Float[Array, ""] = threshold(0.1, "radians")


class Contributions(eqx.Module):
    """Transformations, one for each edge of the reference that starts at the anchor."""

    turn: Float[Array, " n"]
    """Rotation in radians, past the one that the correspondences were sought for."""
    middle: Float[Array, "n 2"]
    """Where the centre of the query's anchors comes to lie, in metres."""
    valid: Bool[Array, " n"]


def contributions(
    reference: AnchorGraph,
    query: AnchorGraph,
    i: Int[Array, ""],
    j: Int[Array, ""],
    rotation: Float[Array, ""],
    centre: Float[Array, "2"],
    config: CorrespondenceConfig,
) -> Contributions:
    """The transformations from the edges at anchors i and j, identified with each other.

    Of the query's edges that may be edge (i, b) of the reference, the one closest in length is
    taken. Middle point comes on middle point, direction on direction.
    """
    unit, length = reference.unit[i], reference.length[i]
    may = reference.valid[i][:, None] & query.valid[j][None, :]
    unit_j, length_j = query.unit[j][None, :], query.length[j][None, :]
    same = config.same(unit[:, None], length[:, None], unit_j, length_j, rotation)
    off = jnp.where(may & same, jnp.abs(length[:, None] - length_j), jnp.inf)
    partner = jnp.argmin(off, axis=1)

    # Sine and cosine of an edge's rotation are products of unit vectors: no angle is needed.
    ours = query.unit[j, partner]
    cos = dot(ours, unit)
    sin = ours[:, 0] * unit[:, 1] - ours[:, 1] * unit[:, 0]
    cos_0, sin_0 = jnp.cos(rotation), jnp.sin(rotation)
    turn = arctan2(sin * cos_0 - cos * sin_0, cos * cos_0 + sin * sin_0)
    arm = centre[None, :] - 0.5 * (query.xy[j][None, :] + query.xy[partner])
    turned = jnp.stack([cos * arm[:, 0] - sin * arm[:, 1], sin * arm[:, 0] + cos * arm[:, 1]], -1)
    middle = 0.5 * (reference.xy[i][None, :] + reference.xy) + turned
    return Contributions(turn=turn, middle=middle, valid=jnp.isfinite(jnp.min(off, axis=1)))


def centre_of_gravity(
    found: Contributions,
    rotation: Float[Array, ""],
    centre: Float[Array, "2"],
    config: ClusterConfig,
) -> tuple[Pose, Float[Array, ""]]:
    """The mean transformation `T_ref_query` of the largest cluster, and its size.

    The cluster is what lies near the contribution with most neighbours; the others are the
    erroneous ones that the clustering is there to drop.
    """
    near = (
        (square_gaps(found.middle, found.middle) <= config.distance**2)
        & found.valid[None, :]
        & found.valid[:, None]
    )
    near = near & (jnp.abs(found.turn[:, None] - found.turn[None, :]) <= config.angle)
    seed = jnp.argmax(jnp.sum(near, axis=1))
    member = near[seed].astype(jnp.float32)
    size = jnp.sum(member)
    share = member / jnp.maximum(size, 1.0)
    angle = rotation + jnp.sum(share * found.turn)
    middle = jnp.sum(share[:, None] * found.middle, axis=0)
    xy = middle - rotate(centre, angle)
    return jnp.concatenate([xy, wrap(angle)[None]]), size
