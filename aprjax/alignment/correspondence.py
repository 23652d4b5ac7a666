"""The anchor point correspondence matrix (paper 2.C, Fig. 2)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import threshold
from aprjax.relations.graph import AnchorGraph
from aprjax.se2 import rotate


class CorrespondenceConfig(eqx.Module):
    """When an edge of the query and one of the reference may be the same."""

    length: Float[Array, ""] = threshold(0.15, "metres that their lengths may differ by")
    angle: Float[Array, ""] = threshold(0.12, "radians that they may be turned off the rotation")


def correspondences(
    reference: AnchorGraph,
    query: AnchorGraph,
    rotation: Float[Array, ""],
    config: CorrespondenceConfig,
) -> Bool[Array, "n n m m"]:
    """Entry (a, b, v, w): edge (a, b) of the reference may be edge (v, w) of the query.

    Edges are taken in both senses and `rotation` (radians) is a full one, so (a, v) and (b, w)
    are identified, but not (a, w) and (b, v): those belong to the opposite rotation. With an
    angle tolerance of π all four of the paper's combinations take part.
    """
    turned = rotate(query.unit, rotation)
    cosine = (
        reference.unit[:, :, None, None, 0] * turned[..., 0]
        + reference.unit[:, :, None, None, 1] * turned[..., 1]
    )
    return (
        (jnp.abs(reference.length[:, :, None, None] - query.length) <= config.length)
        & (cosine >= jnp.cos(config.angle) - 1e-6)
        & reference.valid[:, :, None, None]
        & query.valid
    )


def correspondence_matrix(
    reference: AnchorGraph,
    query: AnchorGraph,
    rotation: Float[Array, ""],
    config: CorrespondenceConfig,
) -> Int[Array, "n m"]:
    """How often anchor i of the reference and anchor j of the query were identified."""
    return jnp.sum(
        correspondences(reference, query, rotation, config), axis=(1, 3), dtype=jnp.int32
    )
