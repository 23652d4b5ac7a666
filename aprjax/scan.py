"""One sweep of a planar laser scanner, and batches of them.

Ranges follow ROS's REP 117: a finite value within the limits (inclusive) is a *hit*; +inf is
*no return*, the beam is known to be free up to `range_max`; everything else (NaN, -inf, a
finite value outside the limits) is *invalid*: nothing is known along that beam.
"""

from collections.abc import Sequence
from typing import Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.numerics import bucket

_SCALARS = ("angle_min", "angle_increment", "range_min", "range_max", "beams")
_FIELDS = ("ranges", *_SCALARS)


class Scan(eqx.Module):
    """A scan in its laser's frame: x forward, angles counter-clockwise, metres and radians.

    Beam i looks along `angle_min + i * angle_increment`. Arrays may be NumPy's or JAX's and may
    carry leading batch axes; `beams` counts the real ones where `ranges` is padded (with NaN).
    Raises `ValueError` where the batch axes of a field are not those of the ranges.
    """

    ranges: Float[Array, "*batch slots"]
    """Metres, as REP 117 has it."""
    angle_min: Float[Array, "*batch"]
    """Bearing of beam 0 in radians."""
    angle_increment: Float[Array, "*batch"]
    """Step to the next beam in radians; negative for a scanner mounted upside down."""
    range_min: Float[Array, "*batch"]
    """Shortest range in metres that is a hit."""
    range_max: Float[Array, "*batch"]
    """Longest range in metres that is a hit, and the free length of a beam without return."""
    beams: Int[Array, "*batch"]
    """How many of the slots are real beams."""

    def __check_init__(self) -> None:
        batch = jnp.shape(self.ranges)[:-1]
        for name in _SCALARS:
            if jnp.shape(getattr(self, name)) != batch:
                raise ValueError(
                    f"{name}: shape {jnp.shape(getattr(self, name))} is not {batch}, the ranges' "
                    "without their last axis"
                )

    @classmethod
    def make(
        cls,
        ranges: Sequence[float] | np.ndarray | Array,
        *,
        angle_min: float,
        angle_increment: float,
        range_min: float = 0.02,
        range_max: float,
    ) -> Self:
        """A checked scan on the host from `ranges` `(beams,)`.

        Raises `ValueError` naming the field and its value if the ranges are not one-dimensional
        and non-empty numbers, if an angle or limit is not finite, if the increment is zero or the
        beams cover more than a full turn, or unless `0 <= range_min < range_max`. No range value
        is refused: what is not a hit and not +inf is invalid, what a NumPy mask hides too. A last
        beam that looks where the first one does is left out. `aprjax.contract` has it as a table.
        """
        given = _numbers(ranges)
        with np.errstate(over="ignore"):
            values = given.astype(np.float32)
        # A finite value that float32 cannot hold is invalid, not free.
        values[np.isinf(values) & np.isfinite(given)] = np.nan
        if values.ndim != 1 or values.size == 0:
            raise ValueError(f"ranges: shape {values.shape} is not (beams,) with at least one beam")
        for name, value in (
            ("angle_min", angle_min),
            ("angle_increment", angle_increment),
            ("range_min", range_min),
            ("range_max", range_max),
        ):
            if not abs(value) <= float(np.finfo(np.float32).max):
                raise ValueError(f"{name}: {value} is not finite in float32")
        # Some drivers report both ends of a turn: the last beam is the first one again.
        if (
            angle_increment == 0
            or abs(angle_increment) * max(values.size - 1, 1) > 2 * np.pi * 1.001
        ):
            raise ValueError(
                f"angle_increment: {angle_increment} rad is zero, or {values.size} beams pass 360°"
            )
        if abs(angle_increment) * (values.size - 0.5) > 2 * np.pi:
            values = values[:-1]
        if not 0 <= range_min < range_max:
            raise ValueError(
                f"range_min: {range_min} m is negative or not below range_max {range_max} m"
            )
        return cls(
            ranges=values,  # pyright: ignore[reportArgumentType]
            **{
                name: np.float32(value)
                for name, value in (
                    ("angle_min", angle_min),
                    ("angle_increment", angle_increment),
                    ("range_min", range_min),
                    ("range_max", range_max),
                )
            },  # pyright: ignore[reportArgumentType]
            beams=np.int32(values.size),  # pyright: ignore[reportArgumentType]
        )

    @property
    def hit(self) -> Bool[Array, "*batch slots"]:
        """Beams that ended on a surface. Zero never is one: many drivers say nothing with it."""
        low, high = self.range_min[..., None], self.range_max[..., None]
        return (self.ranges >= low) & (self.ranges <= high) & (self.ranges > 0) & self.real

    @property
    def no_return(self) -> Bool[Array, "*batch slots"]:
        """Beams known to be free up to `range_max`."""
        return (self.ranges == jnp.inf) & self.real

    @property
    def real(self) -> Bool[Array, "*batch slots"]:
        """Slots that hold a beam of the scanner, not padding."""
        return self._slot < self.beams[..., None]

    @property
    def full_turn(self) -> Bool[Array, "*batch"]:
        """Whether the last beam's neighbour is the first."""
        beams = self.beams.astype(jnp.float32)
        return (beams + 0.5) * jnp.abs(self.angle_increment) > 2 * jnp.pi

    @property
    def bearings(self) -> Float[Array, "*batch slots"]:
        """Directions of the beams in radians."""
        steps = self._slot.astype(jnp.float32)
        return self.angle_min[..., None] + steps * self.angle_increment[..., None]

    @property
    def points(self) -> Float[Array, "*batch slots 2"]:
        """End points of the hits in metres; the origin for every other beam."""
        ranges = jnp.where(self.hit, self.ranges, 0.0)
        return ranges[..., None] * jnp.stack(
            [jnp.cos(self.bearings), jnp.sin(self.bearings)], axis=-1
        )

    @property
    def _slot(self) -> Int[Array, "*#batch slots"]:
        """The number of each slot, with an axis of length one for each batch axis."""
        axes = tuple(range(self.ranges.ndim - 1))
        return jnp.expand_dims(jnp.arange(self.ranges.shape[-1], dtype=jnp.int32), axes)

    def pad(self, slots: int) -> Self:
        """The same scan with `ranges` padded by NaN to `slots` on the host."""
        ranges = np.asarray(self.ranges)
        if slots < ranges.shape[-1]:
            raise ValueError(f"slots: {slots} is fewer than the {ranges.shape[-1]} there are")
        padded = np.full((*ranges.shape[:-1], slots), np.nan, ranges.dtype)
        padded[..., : ranges.shape[-1]] = ranges
        return eqx.tree_at(lambda scan: scan.ranges, self, padded)

    def pad_batch(self, size: int) -> Self:
        """A batch padded on the host to `size` scans; the added ones have no beams.

        Where there are that many nothing is copied.
        """
        missing = size - np.shape(self.ranges)[0]
        if missing == 0:
            return jax.tree.map(np.asarray, self)
        if missing < 0:
            raise ValueError(f"size: {size} is fewer than the {np.shape(self.ranges)[0]} there are")

        def pad(array: Array, fill: float) -> np.ndarray:
            width = [(0, missing)] + [(0, 0)] * (np.ndim(array) - 1)
            return np.pad(np.asarray(array), width, constant_values=fill)

        fills = {"ranges": np.nan, "angle_increment": 1.0, "range_max": 1.0}
        return type(self)(
            **{name: pad(getattr(self, name), fills.get(name, 0)) for name in _FIELDS}  # pyright: ignore[reportArgumentType]
        )

    @classmethod
    def stack(cls, scans: Sequence[Self], slots: int | None = None) -> Self:
        """One batch on the host from scans of any beam counts, padded to `slots` or their bucket.

        Raises `ValueError` for an empty list, and for a scan that is a batch itself.
        """
        if not scans:
            raise ValueError("scans: the list is empty")
        for index, scan in enumerate(scans):
            if np.ndim(scan.ranges) != 1:
                raise ValueError(
                    f"scans[{index}]: ranges have shape {np.shape(scan.ranges)}, not (beams,)"
                )
        most = max(scan.ranges.shape[-1] for scan in scans)
        slots = slots or bucket(most, smallest=64)
        if slots < most:
            raise ValueError(f"slots: {slots} is fewer than the {most} there are")
        columns = {name: np.array([getattr(scan, name) for scan in scans]) for name in _SCALARS}
        ranges = np.full((len(scans), slots), np.nan, np.float32)
        for row, scan in zip(ranges, scans, strict=True):
            row[: scan.ranges.shape[-1]] = scan.ranges
        return cls(ranges=ranges, **columns)  # pyright: ignore[reportArgumentType]


def hide_nan(scans: Scan) -> tuple[Scan, Bool[Array, "*batch slots"]]:
    """Scans with 0 for readings of NaN, and which these are: what may leave a jitted function.

    JAX's `jax_debug_nans` takes a NaN there for a mistake. `show_nan` undoes it.
    """
    silent = jnp.isnan(scans.ranges)
    ranges = jnp.where(silent, 0.0, scans.ranges)
    return eqx.tree_at(lambda scan: scan.ranges, scans, ranges), silent


def show_nan(scans: Scan, silent: np.ndarray) -> Scan:
    """Scans on the host with NaN for the `silent` `(*batch, slots)` readings."""
    ranges = np.where(silent, np.float32(np.nan), scans.ranges)
    return eqx.tree_at(lambda scan: scan.ranges, scans, ranges)


def _numbers(ranges: Sequence[float] | np.ndarray | Array) -> np.ndarray:
    """Ranges of any kind of number as they are, NaN where they are masked."""
    if isinstance(ranges, np.ma.MaskedArray):
        return np.ma.filled(ranges.astype(np.float64), np.nan)
    try:
        given = np.asarray(ranges)
    except ValueError:  # lists of several lengths
        given = np.empty(0, object)
    if not (jnp.issubdtype(given.dtype, jnp.integer) or jnp.issubdtype(given.dtype, jnp.floating)):
        raise ValueError("ranges: they are not a sequence of real numbers")
    return given
