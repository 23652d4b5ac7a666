"""Many arrays as one: each that leaves a device makes its own way to the host."""

import math
from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

_Tree = TypeVar("_Tree")


class Packing(Generic[_Tree]):
    """How trees of one kind lie in rows of words of 32 bits, bit by bit.

    `like` is such a tree, of one row, of `jax.ShapeDtypeStruct`: numbers of 32 bits, and truth
    values.
    """

    def __init__(self, like: _Tree) -> None:
        self._like = like
        self._leaves, self._structure = jax.tree.flatten(like)
        fields = [
            (str(number), np.int32 if leaf.dtype == bool else leaf.dtype, leaf.shape)
            for number, leaf in enumerate(self._leaves)
        ]
        self._row = np.dtype(fields)
        self.words = self._row.itemsize // 4
        """Of a row."""

    def pack(self, tree: _Tree) -> Int[Array, "rows words"]:
        """Arrays `(rows, ...)` side by side.

        Raises `TypeError`, when traced, if they are not of that kind.
        """
        given = jax.tree.map(lambda array: jax.ShapeDtypeStruct(array.shape[1:], array.dtype), tree)
        if jax.tree.flatten(given) != (self._leaves, self._structure):
            raise TypeError(f"{given} are not packed as {self._like}")

        def bits(array: Array) -> Array:
            if array.dtype == bool:
                array = array.astype(jnp.int32)
            number = jax.lax.bitcast_convert_type(array, jnp.int32)
            return number.reshape(array.shape[0], math.prod(array.shape[1:]))

        return jnp.concatenate([bits(leaf) for leaf in jax.tree.leaves(tree)], axis=1)

    def unpack(self, words: Int[np.ndarray, "*rows words"]) -> _Tree:
        """The arrays of which `pack` made `words`, on the host, one by one.

        Those of a single row may come without its axis. Raises `ValueError` for rows of another
        length.
        """
        if words.shape[-1] != self.words:
            raise ValueError(f"words: rows of {words.shape[-1]} are not of {self.words}")
        rows = np.ascontiguousarray(words).view(self._row)[..., 0]

        def found(field: str, truth: bool) -> Any:
            part = rows[field]
            return (part != 0 if truth else part.copy())[()]

        return jax.tree.unflatten(
            self._structure,
            [found(str(k), leaf.dtype == bool) for k, leaf in enumerate(self._leaves)],
        )
