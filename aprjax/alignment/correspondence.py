"""The anchor point correspondence matrix (paper 2.C, Fig. 2)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import threshold
from aprjax.relations.graph import AnchorGraph


class CorrespondenceConfig(eqx.Module):
    """When an edge of the query and one of the reference may be the same."""

    length: Float[Array, ""] = threshold(0.15, "metres that their lengths may differ by")
    angle: Float[Array, ""] = threshold(
        0.12, "radians that they may be turned off the rotation", most=np.pi
    )

    def same(
        self,
        unit_a: Float[Array, "*a 2"],
        length_a: Float[Array, "*a"],
        unit_b: Float[Array, "*b 2"],
        length_b: Float[Array, "*b"],
        rotation: Float[Array, ""],
    ) -> Bool[Array, "*ab"]:
        """Whether edge b, turned by `rotation` (radians), may be edge a; shapes broadcast."""
        cos = unit_a[..., 0] * unit_b[..., 0] + unit_a[..., 1] * unit_b[..., 1]
        sin = unit_a[..., 1] * unit_b[..., 0] - unit_a[..., 0] * unit_b[..., 1]
        # cos(φ_a - φ_b - rotation); the slack keeps a tolerance of π from excluding anything.
        agreement = cos * jnp.cos(rotation) + sin * jnp.sin(rotation)
        parallel = agreement >= jnp.cos(self.angle) - 1e-6
        return parallel & (jnp.abs(length_a - length_b) <= self.length)


def correspondence_matrices(
    reference: AnchorGraph,
    query: AnchorGraph,
    rotations: Float[Array, " rotations"],
    config: CorrespondenceConfig,
) -> Int[Array, "rotations n m"]:
    """How often anchor i of the reference and anchor j of the query were identified.

    One matrix for each of the `rotations` (radians). Edges (a, b) of the reference and (v, w) of
    the query that may be the same identify a with v and b with w. The paper's other combination,
    a with w and b with v, belongs to the opposite rotation; with an angle tolerance of π all
    four of its combinations take part, as in its matrix without the matching angle histogram.
    """
    both = reference.valid[:, :, None, None] & query.valid[None, None, :, :]
    votes = tuple(
        both
        & config.same(
            reference.unit[:, :, None, None],
            reference.length[:, :, None, None],
            query.unit[None, None, :, :],
            query.length[None, None, :, :],
            rotation,
        )
        for rotation in rotations
    )
    # One reduction with several results: XLA then walks the n x n x m x m pairs once for all
    # rotations, not once for each.
    counts = jax.lax.reduce(
        tuple(vote.astype(jnp.int32) for vote in votes),
        tuple(jnp.int32(0) for _ in votes),
        lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True)),
        (1, 3),
    )
    return jnp.stack(counts)
