"""Numerical helpers that every stage shares: precision, norms, angles, look-ups, bucket sizes."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Float, Int

HIGHEST = jax.lax.Precision.HIGHEST
"""Products of coordinates ask for full float32, also where a device defaults to less."""

_Loaded = TypeVar("_Loaded")
_State = TypeVar("_State")

_TINY = float(np.finfo(np.float32).tiny)


@contextmanager
def single_precision() -> Iterator[None]:
    """What the engine is called in: 32 bits, also where the process has allowed JAX 64.

    Counters and indices would else be 64 bits wide, half as fast, and promote what they meet.
    `@single_precision()` puts a whole function in it.
    """
    if hasattr(jax, "enable_x64"):
        setting = jax.enable_x64(False)
    else:
        from jax.experimental import disable_x64  # pyright: ignore[reportAttributeAccessIssue]

        setting = disable_x64()
    with setting:
        yield


def wrap(angle: Float[Array, "..."], period: float = 2 * np.pi) -> Float[Array, "..."]:
    """`angle` in radians, shifted by whole periods into [-period / 2, period / 2)."""
    return jnp.mod(angle + period / 2, period) - period / 2


def dot(a: Float[Array, "... d"], b: Float[Array, "... d"]) -> Float[Array, "..."]:
    """Products of vectors with few components.

    Component by component: XLA on a CPU does not vectorise a sum over so short an axis.
    """
    total = a[..., 0] * b[..., 0]
    for k in range(1, a.shape[-1]):
        total = total + a[..., k] * b[..., k]
    return total


def total(array: Float[Array, "... n"]) -> Float[Array, "..."]:
    """The sum over the last axis, as a product with ones.

    XLA on a CPU would fuse a plain sum with all that leads up to it, again for every sum of the
    same beams, and then vectorise none of it.
    """
    return jnp.matmul(array, jnp.ones(array.shape[-1], array.dtype), precision=HIGHEST)


def sums(*terms: Float[Array, "n ..."]) -> tuple[Float[Array, "..."], ...]:
    """The sum of each over its first axis, all in one pass.

    As sums of their own, XLA on a CPU would compile and compute what they share again for each.
    """
    zeros = tuple(np.zeros((), term.dtype) for term in terms)
    return jax.lax.reduce(terms, zeros, lambda a, b: tuple(map(jnp.add, a, b)), (0,))


@custom_vmap
def take(array: Float[Array, "*rows n"], index: Int[Array, "*at"]) -> Float[Array, "..."]:
    """`array[..., index]` for indices that are known to be in bounds.

    Mapped over arrays `(n,)` of its own, each looks up in one long array: XLA on a CPU would
    spread every index into one for each axis, at several times the cost of the look-up. It has no
    reverse-mode derivative.
    """
    return array.at[..., index].get(mode="promise_in_bounds")


@take.def_vmap
def _take_mapped(size: int, mapped: list[bool], array: Array, index: Array) -> tuple[Array, bool]:
    array_mapped, index_mapped = mapped
    if not index_mapped:
        return take(array, index), True
    if not array_mapped:
        return jnp.moveaxis(take(array, index), array.ndim - 1, 0), True
    if array.ndim > 2:
        return jax.vmap(lambda a, i: a.at[..., i].get(mode="promise_in_bounds"))(array, index), True
    first = jnp.arange(size, dtype=index.dtype) * array.shape[1]
    return take(array.reshape(-1), index + first.reshape(-1, *[1] * (index.ndim - 1))), True


def in_turn(
    rounds: int | Int[Array, ""],
    load: Callable[[Int[Array, ""]], _Loaded],
    use: Callable[[_Loaded, _State], _State],
    state: _State,
) -> _State:
    """`state = use(load(i), state)` for every round i, each loaded in the round before its use.

    XLA on a CPU fuses look-ups, and the indices that lead to them, into everything that uses
    them: it does them again for each, and then vectorises none of it. What one round of a loop
    hands to the next is computed once.
    """

    def round_(i: Int[Array, ""], carry: tuple[_Loaded, _State]) -> tuple[_Loaded, _State]:
        loaded, state = carry
        return load(i + 1), use(loaded, state)

    first = jnp.int32(0)
    return jax.lax.fori_loop(first, rounds, round_, (load(first), state))[1]


def in_parts(use: Callable[[_Loaded], _State], loaded: _Loaded, parts: int = 2) -> _State:
    """`use(loaded)`, part after part of the leading axis; in one part if it cannot be divided.

    As `in_turn` for what can be computed at once: a loop, however short, is given what was computed
    before it.
    """
    rows = jax.tree.leaves(loaded)[0].shape[0]
    parts = parts if rows % parts == 0 else 1
    divided = jax.tree.map(lambda a: a.reshape(parts, rows // parts, *a.shape[1:]), loaded)
    used = jax.lax.map(use, divided)
    return jax.tree.map(lambda a: a.reshape(rows, *a.shape[2:]), used)


def running_max(values: Int[Array, " n"]) -> Int[Array, " n"]:
    """The greatest of each value and all before it.

    By doubling, in a loop: `jax.lax.cummax` writes out every step, which takes long to compile.
    """
    index = jnp.arange(values.shape[0])

    def look_back(step: Array, greatest: Array) -> Array:
        earlier = jnp.maximum(index - (1 << step), 0)
        return jnp.maximum(greatest, greatest[earlier])

    first = jnp.int32(0)
    return jax.lax.fori_loop(first, values.shape[0].bit_length(), look_back, values)


def running_min_from_end(values: Int[Array, " n"]) -> Int[Array, " n"]:
    """The least of each value and all after it."""
    return -running_max(-values[::-1])[::-1]


def first_max(values: Float[Array, " n"]) -> Int[Array, ""]:
    """Where the greatest value is, the first of equals.

    XLA on a CPU vectorises a maximum and a minimum, but not `argmax`.
    """
    index = jnp.arange(values.shape[0])
    return jnp.min(jnp.where(values == jnp.max(values), index, values.shape[0] - 1))


def safe_norm(vector: Float[Array, "... d"]) -> Float[Array, "..."]:
    """Euclidean norm over the last axis whose gradient at the origin is zero, not NaN.

    Padding puts zero vectors everywhere, and one NaN gradient would spoil a whole batch.
    """
    square = dot(vector, vector)
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def square_gaps(a: Float[Array, "n 2"], b: Float[Array, "m 2"]) -> Float[Array, "n m"]:
    """Square distances of all pairs of points."""
    dx, dy = a[:, 0][:, None] - b[:, 0][None, :], a[:, 1][:, None] - b[:, 1][None, :]
    return dx * dx + dy * dy


# arctan(t) / t on [0, 1] by powers of t²: the polynomial of least maximum error.
_ARCTAN = (
    0.999999344,
    -0.333298594,
    0.199465662,
    -0.139086291,
    0.0964219719,
    -0.055912327,
    0.0218629576,
    -0.00405456731,
)


@jax.custom_jvp
def arctan2(y: Float[Array, "..."], x: Float[Array, "..."]) -> Float[Array, "..."]:
    """The angle of `(x, y)` in radians, in [-π, π], to 4e-7; zero at the origin.

    A polynomial, because XLA's own takes some twenty times as long on a CPU, and points are
    looked up by their bearing wherever scans are compared.
    """
    along, across = jnp.abs(x), jnp.abs(y)
    slope = jnp.minimum(along, across) / jnp.maximum(jnp.maximum(along, across), _TINY)
    square = slope * slope
    angle = jnp.full_like(square, _ARCTAN[-1])
    for coefficient in _ARCTAN[-2::-1]:
        angle = angle * square + coefficient
    angle = angle * slope
    angle = jnp.where(across > along, np.float32(np.pi / 2) - angle, angle)
    angle = jnp.where(x < 0, np.float32(np.pi) - angle, angle)
    return jnp.copysign(angle, y)


@arctan2.defjvp
def _arctan2_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]):
    (y, x), (dy, dx) = primals, tangents
    return arctan2(y, x), (x * dy - y * dx) / (x * x + y * y)


def safe_arctan2(y: Float[Array, "..."], x: Float[Array, "..."]) -> Float[Array, "..."]:
    """`arctan2` in radians whose gradient at the origin is zero, not NaN."""
    origin = (x == 0) & (y == 0)
    return jnp.where(origin, 0.0, arctan2(jnp.where(origin, 0.0, y), jnp.where(origin, 1.0, x)))


def bucket(size: int, smallest: int = 8) -> int:
    """The array length that `size` items are padded to: 8, 10, 12, 14, 16, 20, 24, 28, 32, …

    Four steps to the octave: few enough shapes that compilations stay rare, close enough that
    at most a fifth of the work is padding.
    """
    if size <= smallest:
        return smallest
    step = 1 << max((size - 1).bit_length() - 3, 0)
    return -(-size // step) * step
