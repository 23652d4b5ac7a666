"""The assembled frame with the contradictions of its cycles spread over the arcs: a pose graph.

For drawing and for export. The world model itself keeps its arcs as they were measured.
"""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int

from aprjax.numerics import HIGHEST, bucket, single_precision, wrap
from aprjax.se2 import compose, inverse
from aprjax.world.model import WorldModel
from aprjax.world.super_space import assemble

_STEPS = 100
_SCALE = 16.0  # squared deviations, over three numbers, at which an arc has lost half its say


@single_precision()
def relax(world: WorldModel, root: int | None = None) -> dict[int, np.ndarray]:
    """Poses `(3,)` of the nodes that `root` (by default the first node) reaches, in its frame.

    They minimise what the arcs between them contradict, each arc weighed by its covariance and,
    from the plain minimum on, by Cauchy's robust loss: an arc that no other agrees with gives way.
    Raises `WorldModelError` for an unknown root.
    """
    frame = assemble(world, root)
    nodes = list(frame)
    row = {node: index for index, node in enumerate(nodes)}
    arcs = [arc for arc in world.arcs() if arc.a in frame]
    if not arcs:
        return frame

    size = bucket(len(arcs))
    ends = np.zeros((size, 2), np.int32)
    measured, root_information = np.zeros((size, 3), np.float32), np.zeros((size, 3, 3), np.float32)
    for index, arc in enumerate(arcs):
        ends[index] = row[arc.a], row[arc.b]
        measured[index] = arc.T_a_b
        # Not so much narrower one way than another that its inverse is none in float64.
        least = max(1e-8, 1e-10 * np.trace(arc.covariance))
        covariance = arc.covariance + least * np.eye(3)
        root_information[index] = np.linalg.cholesky(np.linalg.inv(covariance)).T
    start = np.zeros((bucket(len(nodes)), 3), np.float32)
    start[: len(nodes)] = np.array([frame[node] for node in nodes])
    poses = np.asarray(_solve(start, ends, measured, root_information), float)
    return {node: poses[index] for node, index in row.items()}


@jax.jit
def _solve(
    start: Float[Array, "nodes 3"],
    ends: Int[Array, "arcs 2"],
    measured: Float[Array, "arcs 3"],
    root_information: Float[Array, "arcs 3 3"],
) -> Float[Array, "nodes 3"]:
    """The first pose stays at the origin; padding has no weight, or nothing that moves it."""

    def off(poses: Float[Array, "nodes 3"]) -> Float[Array, "arcs 3"]:
        T_a_b = compose(inverse(poses[ends[:, 0]]), poses[ends[:, 1]])
        gap = T_a_b - measured
        gap = jnp.concatenate([gap[:, :2], wrap(gap[:, 2:])], axis=-1)
        return jnp.einsum("aij,aj->ai", root_information, gap, precision=HIGHEST)

    def held(poses: Float[Array, "nodes 3"]) -> Float[Array, "nodes 3"]:
        stiffness = jnp.full((start.shape[0], 1), 1e-3).at[0].set(1e3)
        return stiffness * (poses - start)

    def plain(poses, _):
        return off(poses), held(poses)

    def robust(poses, _):
        residual = off(poses)
        share = jnp.sum(residual * residual, axis=1, keepdims=True) / _SCALE
        # Cauchy's loss as a factor on the residual; its limit is one where the residual vanishes.
        small = share < 1e-6
        safe = jnp.where(small, 1.0, share)
        factor = jnp.where(small, 1.0, jnp.sqrt(jnp.log1p(safe) / safe))
        return residual * factor, held(poses)

    poses = start
    for residuals in (plain, robust):
        solver = optx.LevenbergMarquardt(rtol=1e-5, atol=1e-5)
        solution = optx.least_squares(residuals, solver, poses, max_steps=_STEPS, throw=False)
        poses = solution.value
    return jnp.concatenate([poses[:, :2], wrap(poses[:, 2:])], axis=-1)
