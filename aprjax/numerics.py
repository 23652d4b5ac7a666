"""Numerical helpers that every stage shares: safe norms, angles, bucket sizes."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

HIGHEST = jax.lax.Precision.HIGHEST
"""Products of coordinates ask for full float32, also where a device defaults to less."""


def wrap(angle: Float[Array, "..."], period: float = 2 * np.pi) -> Float[Array, "..."]:
    """`angle` in radians, shifted by whole periods into [-period / 2, period / 2)."""
    return jnp.mod(angle + period / 2, period) - period / 2


def safe_norm(vector: Float[Array, "... d"]) -> Float[Array, "..."]:
    """Euclidean norm over the last axis whose gradient at the origin is zero, not NaN.

    Padding puts zero vectors everywhere, and one NaN gradient would spoil a whole batch.
    """
    square = jnp.sum(vector * vector, axis=-1)
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def safe_arctan2(y: Float[Array, "..."], x: Float[Array, "..."]) -> Float[Array, "..."]:
    """`arctan2` in radians whose gradient at the origin is zero, not NaN."""
    origin = (x == 0) & (y == 0)
    return jnp.where(origin, 0.0, jnp.arctan2(jnp.where(origin, 0.0, y), jnp.where(origin, 1.0, x)))


def bucket(size: int, smallest: int = 8) -> int:
    """The array length that `size` items are padded to: 8, 10, 12, 14, 16, 20, 24, 28, 32, …

    Four steps to the octave: few enough shapes that compilations stay rare, close enough that
    at most a fifth of the work is padding.
    """
    if size <= smallest:
        return smallest
    step = 1 << max((size - 1).bit_length() - 3, 0)
    return -(-size // step) * step
