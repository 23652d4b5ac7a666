"""Many arrays as one: each that leaves a device makes its own way to the host."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int


def width(like: Any) -> int:
    """How many words a row takes of arrays with the shapes of `like`."""
    return sum(math.prod(leaf.shape) for leaf in jax.tree.leaves(like))


def pack(tree: Any) -> Int[Array, "rows words"]:
    """Arrays `(rows, ...)` of 32 bits, or of truth values, side by side and bit by bit."""

    def words(array: Array) -> Array:
        if array.dtype == bool:
            array = array.astype(jnp.int32)
        bits = jax.lax.bitcast_convert_type(array, jnp.int32)
        return bits.reshape(array.shape[0], math.prod(array.shape[1:]))

    return jnp.concatenate([words(leaf) for leaf in jax.tree.leaves(tree)], axis=1)


def unpack(words: np.ndarray, like: Any) -> Any:
    """The arrays that `pack` packed, on the host: `like` has their shapes, less the rows'."""
    leaves, structure = jax.tree.flatten(like)
    found, start = [], 0
    for leaf in leaves:
        stop = start + math.prod(leaf.shape)
        part = words[:, start:stop].reshape(len(words), *leaf.shape)
        found.append(part != 0 if leaf.dtype == bool else part.view(leaf.dtype))
        start = stop
    return jax.tree.unflatten(structure, found)
