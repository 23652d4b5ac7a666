"""Local refinement of an alignment: point-to-line least squares between two scans.

Not in the paper, which evaluates the centre of gravity as it is; anchors place a scan to about a
decimetre and two degrees, and the congruence of raw data needs better. A few Gauss-Newton steps
with a robust weight (Tukey's) whose scale shrinks.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.view import View
from aprjax.numerics import HIGHEST, wrap
from aprjax.se2 import Pose, transform


class RefineConfig(eqx.Module):
    """How points and surfaces are paired, and how often."""

    gate: Float[Array, ""] = threshold(0.5, "metres off the surface that are allowed at first")
    final_gate: Float[Array, ""] = threshold(0.1, "metres at last")
    reach: Float[Array, ""] = threshold(3.0, "gates that paired points may lie apart in all")
    noise: Float[Array, ""] = threshold(0.02, "metres: least standard deviation off the surface")
    prior: Float[Array, ""] = threshold(
        1.0, "metres and radians: standard deviation of each coordinate where nothing holds it"
    )
    points: int = capacity(128, "most end points of the query that are paired")
    iterations: int = capacity(6, "Gauss-Newton steps")


class Refined(eqx.Module):
    """A refined alignment."""

    T_ref_query: Pose
    """Metres and radians."""
    covariance: Float[Array, "*batch 3 3"]
    """m², m rad, rad²: long in a direction in which no surface holds the query."""


class _System(eqx.Module):
    """Gauss-Newton normal equations in (x, y, theta)."""

    information: Float[Array, "3 3"]
    gradient: Float[Array, "3"]
    variance: Float[Array, ""]
    """Weighted mean square distance off the surfaces in m²."""


def refine(reference: View, query: View, T_ref_query: Pose, config: RefineConfig) -> Refined:
    """The pose near `T_ref_query` at which the query's end points lie on the reference's surfaces.

    Where no points can be paired the pose stays as it is. The covariance is the inverse of the
    curvature times the residual variance, with a weak prior that keeps it finite.
    """

    def step(T_ref_query: Pose, gate: Float[Array, ""]) -> tuple[Pose, None]:
        system = _linearise(reference, query, T_ref_query, gate, config)
        # One unit of damping is one point: nothing against a wall, enough along a corridor.
        damped = _inverse(system.information + jnp.eye(3))
        T_ref_query = T_ref_query - jnp.matmul(damped, system.gradient, precision=HIGHEST)
        return T_ref_query.at[2].set(wrap(T_ref_query[2])), None

    shrink = config.final_gate / config.gate
    gates = config.gate * shrink ** jnp.linspace(0.0, 1.0, config.iterations)
    T_ref_query, _ = jax.lax.scan(step, T_ref_query, gates)
    system = _linearise(reference, query, T_ref_query, config.final_gate, config)
    variance = jnp.maximum(system.variance, config.noise**2)
    information = system.information / variance + jnp.eye(3) / config.prior**2
    return Refined(T_ref_query, _inverse(information))


def _linearise(
    reference: View, query: View, T_ref_query: Pose, gate: Float[Array, ""], config: RefineConfig
) -> _System:
    """Pair end points with the surfaces seen in their direction; weights fall to 0 at the gate."""
    beam, real = query.thin(config.points)
    xy = transform(T_ref_query, query.xy[beam])
    index, visible = reference.look_up(xy)
    normal = reference.normal[index]
    gap = xy - reference.xy[index]
    off = jnp.sum(normal * gap, axis=-1)
    near = jnp.sum(gap * gap, axis=-1) < (config.reach * gate) ** 2
    paired = query.hit[beam] & real & visible & near & jnp.any(normal != 0, axis=-1)
    weight = jnp.where(paired, jnp.maximum(1.0 - (off / gate) ** 2, 0.0) ** 2, 0.0)
    arm = xy - T_ref_query[None, :2]
    turning = normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]
    jacobian = jnp.concatenate([normal, turning[:, None]], axis=-1)
    weighted = (weight[:, None] * jacobian).T
    return _System(
        information=jnp.matmul(weighted, jacobian, precision=HIGHEST),
        gradient=jnp.matmul(weighted, off, precision=HIGHEST),
        variance=jnp.sum(weight * off * off) / jnp.maximum(jnp.sum(weight), 1.0),
    )


def _inverse(matrix: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """Inverse of a symmetric positive definite matrix by its factors L D Lᵀ, unrolled.

    LAPACK is called matrix by matrix, which would cost more than all the rest of a step, and
    cofactors lose the sign in float32 where a surface is far away. Pivots are kept positive, so
    the result always is positive definite.
    """
    tiny = jnp.finfo(jnp.float32).tiny
    d0 = jnp.maximum(matrix[0, 0], tiny)
    l10, l20 = matrix[1, 0] / d0, matrix[2, 0] / d0
    d1 = jnp.maximum(matrix[1, 1] - l10 * l10 * d0, 1e-6 * matrix[1, 1])
    l21 = (matrix[2, 1] - l20 * l10 * d0) / d1
    d2 = jnp.maximum(matrix[2, 2] - l20 * l20 * d0 - l21 * l21 * d1, 1e-6 * matrix[2, 2])
    one, zero = jnp.ones(()), jnp.zeros(())
    rows = [
        jnp.stack([one, zero, zero]) / jnp.sqrt(d0),
        jnp.stack([-l10, one, zero]) / jnp.sqrt(d1),
        jnp.stack([l10 * l21 - l20, -l21, one]) / jnp.sqrt(d2),
    ]
    inverse_factor = jnp.stack(rows)
    return jnp.matmul(inverse_factor.T, inverse_factor, precision=HIGHEST)
