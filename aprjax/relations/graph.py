"""Anchor point graphs: the complete graph over the anchors of a scan (paper 2.A, Fig. 1).

An edge is e = (p_a, p_b, d). The graph is kept as dense `anchors x anchors` arrays, in which an
edge occurs in both senses: (a, b) with its direction and (b, a) with the opposite one.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.anchors.extract import Anchors
from aprjax.numerics import safe_norm


class AnchorGraph(eqx.Module):
    """The edges of one anchor graph."""

    xy: Float[Array, "*batch anchors 2"]
    """Anchor points in metres, in the laser's frame."""
    length: Float[Array, "*batch anchors anchors"]
    """d in metres."""
    unit: Float[Array, "*batch anchors anchors 2"]
    """Direction from a to b as a unit vector; zero where not valid."""
    valid: Bool[Array, "*batch anchors anchors"]
    """Both ends are real and differ."""

    @property
    def edges(self) -> Int[Array, "*batch"]:
        """k: the number of (undirected) edges."""
        return jnp.sum(self.valid, axis=(-2, -1)) // 2


def anchor_graph(anchors: Anchors) -> AnchorGraph:
    """The complete graph over the valid anchors of one scan."""
    xy = jnp.where(anchors.valid[:, None], anchors.xy, 0.0)
    gap = xy[None, :, :] - xy[:, None, :]
    length = safe_norm(gap)
    valid = anchors.valid[:, None] & anchors.valid[None, :] & (length > 0)
    return AnchorGraph(
        xy=xy,
        length=jnp.where(valid, length, 0.0),
        unit=jnp.where(valid[..., None], gap / jnp.where(valid, length, 1.0)[..., None], 0.0),
        valid=valid,
    )
