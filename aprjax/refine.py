"""Local refinement of an alignment: point-to-line least squares between two scans."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aprjax.evaluation.view import View
from aprjax.configuration import capacity, threshold
from aprjax.numerics import wrap
from aprjax.se2 import Pose, rotate, transform


class RefineConfig(eqx.Module):
    """How points and surfaces are paired, and how often."""

    gate: Float[Array, ""] = threshold(0.5, "metres off the surface that are allowed at first")
    final_gate: Float[Array, ""] = threshold(0.1, "metres at last")
    noise: Float[Array, ""] = threshold(0.02, "metres: least standard deviation off the surface")
    iterations: int = capacity(8, "Gauss-Newton steps")


class Refined(eqx.Module):
    T_ref_query: Pose
    covariance: Float[Array, "*batch 3 3"]


def refine(reference: View, query: View, T_ref_query: Pose, config: RefineConfig) -> Refined:
    def step(T, progress):
        gate = config.gate * (config.final_gate / config.gate) ** progress
        information, gradient, _ = _normal_equations(reference, query, T, gate)
        damped = information + jnp.diag(jnp.array([1.0, 1.0, 1.0]))
        update = -_solve(damped, gradient)
        return jnp.concatenate([T[:2] + update[:2], wrap(T[2:] + update[2:])]), None

    progress = jnp.linspace(0.0, 1.0, config.iterations)
    T, _ = jax.lax.scan(step, T_ref_query, progress)
    information, _, variance = _normal_equations(reference, query, T, config.final_gate)
    covariance = _inverse(information + jnp.eye(3)) * jnp.maximum(variance, config.noise**2)
    return Refined(T, covariance)


def _normal_equations(reference, query, T, gate):
    xy = transform(T, query.xy)
    index, visible = reference.look_up(xy)
    normal = reference.normal[index]
    off = jnp.sum(normal * (xy - reference.xy[index]), axis=-1)
    gap = xy - reference.xy[index]
    paired = query.hit & visible & jnp.any(normal != 0, axis=-1)
    weight = jnp.where(paired, jnp.maximum(1.0 - (off / gate) ** 2, 0.0) ** 2, 0.0)
    weight = weight * (jnp.sum(gap * gap, axis=-1) < (3 * gate) ** 2 + 0.04)
    arm = xy - T[:2]
    jacobian = jnp.concatenate(
        [normal, (normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1])[:, None]], axis=-1
    )
    weighted = weight[:, None] * jacobian
    information = weighted.T @ jacobian
    gradient = weighted.T @ off
    variance = jnp.sum(weight * off * off) / jnp.maximum(jnp.sum(weight), 1.0)
    return information, gradient, variance


def _inverse(matrix: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """Inverse of a positive definite matrix by cofactors, which batches where LAPACK does not."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    cofactors = jnp.array(
        [
            [d * f - e * e, c * e - b * f, b * e - c * d],
            [c * e - b * f, a * f - c * c, b * c - a * e],
            [b * e - c * d, b * c - a * e, a * d - b * b],
        ]
    )
    return cofactors / jnp.maximum(
        a * cofactors[0, 0] + b * cofactors[0, 1] + c * cofactors[0, 2], 1e-12
    )


def _solve(matrix, vector):
    return _inverse(matrix) @ vector
