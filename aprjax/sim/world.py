"""What a scanner can hit: line segments and circles in the plane of its beams."""

from collections.abc import Sequence
from typing import Self

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float


class World(eqx.Module):
    """Surfaces at a scanner's height. Arrays may be NumPy's or JAX's, with leading batch axes."""

    segments: Float[Array, "*batch S 2 2"]
    """Both ends in metres; a segment of length zero is padding and never hit."""
    circles: Float[Array, "*batch C 3"]
    """x, y and radius in metres; a circle of radius zero is padding and never hit."""

    @classmethod
    def make(
        cls,
        segments: Sequence | np.ndarray = (),
        circles: Sequence | np.ndarray = (),
    ) -> Self:
        """A checked world on the host from `segments` `(S, 2, 2)` and `circles` `(C, 3)`.

        Raises `ValueError` naming the field, index and value for another shape, for a number
        that is not finite in float32, and for a negative radius.
        """
        arrays = {}
        for name, given, shape in (("segments", segments, (2, 2)), ("circles", circles, (3,))):
            with np.errstate(over="ignore"):
                array = np.asarray(given, np.float32)
            array = array.reshape(0, *shape) if array.size == 0 else array
            if array.shape[1:] != shape:
                raise ValueError(f"{name}: shape {array.shape} is not (any number, *{shape})")
            wrong = np.argwhere(~np.isfinite(array))
            if wrong.size:
                index = tuple(wrong[0].tolist())
                where = ", ".join(map(str, index))
                raise ValueError(f"{name}[{where}]: {array[index]} is not finite in float32")
            arrays[name] = array
        negative = np.flatnonzero(arrays["circles"][:, 2] < 0)
        if negative.size:
            radius = arrays["circles"][negative[0], 2]
            raise ValueError(f"circles[{negative[0]}]: radius {radius} m is negative")
        return cls(**arrays)

    def pad(self, segments: int, circles: int) -> Self:
        """The same world on the host, padded to so many `segments` and `circles`.

        Raises `ValueError` if there are more of either.
        """

        def padded(name: str, size: int, item_axes: int) -> np.ndarray:
            array = np.asarray(getattr(self, name))
            missing = size - array.shape[-item_axes - 1]
            if missing < 0:
                raise ValueError(f"{name}: {size} is fewer than the {size - missing} there are")
            before = array.ndim - item_axes - 1
            return np.pad(array, [(0, 0)] * before + [(0, missing)] + [(0, 0)] * item_axes)

        return type(self)(
            segments=padded("segments", segments, 2),  # pyright: ignore[reportArgumentType]
            circles=padded("circles", circles, 1),  # pyright: ignore[reportArgumentType]
        )
