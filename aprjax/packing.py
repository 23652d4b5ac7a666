"""Many arrays as one: each that leaves a device makes its own way to the host."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int


def pack(tree: Any, like: Any) -> Int[Array, "rows words"]:
    """Arrays `(rows, ...)` of 32 bits, or of truth values, side by side and bit by bit.

    `like` is what `unpack` will take them for: the same tree, of one row, as
    `jax.ShapeDtypeStruct`. Raises `TypeError`, when traced, if the arrays are not that.
    """
    given = jax.tree.map(lambda array: jax.ShapeDtypeStruct(array.shape[1:], array.dtype), tree)
    if jax.tree.flatten(given) != jax.tree.flatten(like):
        raise TypeError(f"{given} are not packed as {like}")

    def bits(array: Array) -> Array:
        if array.dtype == bool:
            array = array.astype(jnp.int32)
        number = jax.lax.bitcast_convert_type(array, jnp.int32)
        return number.reshape(array.shape[0], math.prod(array.shape[1:]))

    return jnp.concatenate([bits(leaf) for leaf in jax.tree.leaves(tree)], axis=1)


def unpack(words: Int[np.ndarray, "*rows words"], like: Any) -> Any:
    """The arrays of which `pack` made `words`, on the host, one by one.

    Those of a single row may come without its axis.
    """
    leaves, structure = jax.tree.flatten(like)
    views = {np.dtype(kind): words.view(kind) for kind in (np.int32, np.float32)}
    found, start = [], 0
    for leaf in leaves:
        stop, truth = start + math.prod(leaf.shape), leaf.dtype == bool
        part = views[np.dtype(np.int32) if truth else leaf.dtype][..., start:stop]
        part = np.ascontiguousarray(part).reshape((*words.shape[:-1], *leaf.shape))[()]
        found.append(part != 0 if truth else part)
        start = stop
    return jax.tree.unflatten(structure, found)
