"""Anchor candidates of all kinds, and the choice of the most salient, well apart."""

import enum
from typing import Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class Kind(enum.IntEnum):
    """The three types of anchor point of paper 2.A."""

    JUMP_EDGE = 0
    ANGLE = 1
    VIRTUAL_EDGE = 2


_FEW = 256  # candidates that are all looked at, those for pairs of lines among them


class Candidates(eqx.Module):
    """Points that may become anchors."""

    xy: Float[Array, "candidates 2"]
    """Metres in the laser's frame."""
    kind: Int[Array, " candidates"]
    salience: Float[Array, " candidates"]
    """Larger is better; comparable between the kinds."""
    valid: Bool[Array, " candidates"]

    @classmethod
    def join(cls, *parts: Self) -> Self:
        """All candidates of `parts`."""
        return jax.tree.map(lambda *arrays: jnp.concatenate(arrays), *parts)

    def best(self, size: int, apart: Float[Array, ""]) -> tuple[Self, Int[Array, ""]]:
        """The `size` most salient, any two at least `apart` metres from each other.

        A candidate nearer than that to a more salient one is the same point seen twice. Also
        returns how many distinct points did not fit, counted up to `size`. The most salient half
        of the candidates is looked at, which holds all valid ones: of the three that there are for
        each hit on a large part, one at most is (a corner lies inside, a jump edge at an end).
        """
        salience = jnp.where(self.valid, self.salience, -jnp.inf)
        half = max(salience.shape[0] // 2, _FEW)
        salience, order = jax.lax.top_k(salience, min(half, salience.shape[0]))
        x, y = self.xy[order, 0], self.xy[order, 1]
        none = order.shape[0]

        def choose(left, _):
            first = jnp.min(left)
            pick = jnp.minimum(first, none - 1)
            same = (x - x[pick]) ** 2 + (y - y[pick]) ** 2 < apart**2
            return jnp.where(same | (left == first), none, left), first

        left = jnp.where(salience > -jnp.inf, jnp.arange(none), none)
        _, first = jax.lax.scan(choose, left, length=2 * size)
        valid = first < none
        chosen = order[jnp.minimum(first[:size], none - 1)]
        picked = jax.tree.map(lambda array: array[chosen], self)
        overflow = jnp.sum(valid[size:], dtype=jnp.int32)
        return eqx.tree_at(lambda c: c.valid, picked, valid[:size]), overflow
