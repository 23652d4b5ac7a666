"""One sweep of a planar laser scanner, and batches of them.

Ranges follow ROS's REP 117: a finite value within the limits (inclusive) is a *hit*; +inf is
*no return*, the beam is known to be free up to `range_max`; everything else (NaN, -inf, a
finite value outside the limits) is *invalid*: nothing is known along that beam.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import real_numbers, shown
from aprjax.numerics import bucket

WIDEST = 2 * np.pi * 1.001
"""Radians from the first beam to the last, at most: a full turn, but for rounding."""
_SCALARS = ("angle_min", "angle_increment", "range_min", "range_max", "beams")
_FIELDS = ("ranges", *_SCALARS)
_DTYPES = dict.fromkeys(_FIELDS, np.dtype(np.float32)) | {"beams": np.dtype(np.int32)}


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
        batch = np.shape(self.ranges)[:-1]
        for name in _SCALARS:
            shape = np.shape(getattr(self, name))
            if shape != batch:
                raise ValueError(
                    f"{name}: shape {shape} is not {batch}, the ranges' without their last axis"
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
        and non-empty numbers, if an angle or limit is no finite number, if the increment is zero
        or the beams cover more than a full turn, or unless `0 <= range_min < range_max`, all of
        them as float32. No range value is refused: what is not a hit and not +inf is invalid, what
        a NumPy mask hides too. A last beam that looks where the first one does, to a tenth of the
        increment, is left out. `aprjax.contract` has it as a table.
        """
        values = _single(_numbers("ranges", ranges))
        if values.ndim != 1 or values.size == 0:
            raise ValueError(f"ranges: shape {values.shape} is not (beams,) with at least one beam")
        # What is stored is what is checked.
        kept = {
            name: _finite(name, value)
            for name, value in (
                ("angle_min", angle_min),
                ("angle_increment", angle_increment),
                ("range_min", range_min),
                ("range_max", range_max),
            )
        }
        step = abs(float(kept["angle_increment"]))
        # Some drivers report both ends of a turn: the last beam is the first one again.
        if step == 0 or step * max(values.size - 1, 1) > WIDEST:
            raise ValueError(
                f"angle_increment: {angle_increment} rad is zero, or {values.size} beams pass 360°"
            )
        if step * (values.size - 0.9) >= 2 * np.pi:
            values = values[:-1]
        if not 0 <= kept["range_min"] < kept["range_max"]:
            raise ValueError(
                f"range_min: {range_min} m is negative or not below range_max {range_max} m"
            )
        return cls(
            ranges=values,  # pyright: ignore[reportArgumentType]
            **kept,  # pyright: ignore[reportArgumentType]
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
    def stack(cls, scans: Iterable[Self], slots: int | None = None) -> Self:
        """One batch on the host from scans of any beam counts, padded to `slots` or their bucket.

        Raises `ValueError` for an empty list, for what is no scan or a batch itself, for more
        beams than ranges, and as `check_columns`.
        """
        if not isinstance(scans, Iterable):
            raise ValueError(f"scans: {type(scans).__name__} is no list of scans")
        scans = list(scans)
        if not scans:
            raise ValueError("scans: the list is empty")
        for index, scan in enumerate(scans):
            if not isinstance(scan, Scan):
                raise ValueError(f"scans[{index}]: {type(scan).__name__} is no Scan")
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
            row[: scan.ranges.shape[-1]] = _typed("ranges", scan.ranges)
        columns = {name: _typed(name, column) for name, column in columns.items()}
        for index, scan in enumerate(scans):
            beams = columns["beams"][index]
            if not 0 <= beams <= scan.ranges.shape[-1]:
                raise ValueError(
                    f"scans[{index}]: {beams} beams is not from 0 to {scan.ranges.shape[-1]}"
                )
        check_columns(columns, slots)
        return cls(ranges=ranges, **columns)  # pyright: ignore[reportArgumentType]


def as_stack(scans: Sequence[Scan] | Scan, of: str = "references") -> Scan:
    """Stacked scans `(any, slots)` in the documented dtypes, from a list or a stacked `Scan`.

    `of` is what they are, for the message. Raises `ValueError` for other shapes, for none, for
    what are no numbers, and as `check_columns`.
    """
    if not isinstance(scans, Scan):
        return Scan.stack(scans)
    shape = np.shape(scans.ranges)
    if len(shape) != 2 or 0 in shape:
        raise ValueError(f"scans: ranges of shape {shape} are not ({of}, beams)")
    given = {name: getattr(scans, name) for name in _FIELDS}
    fields = {name: _typed(name, values) for name, values in given.items()}
    check_columns(fields, shape[1])
    if all(fields[name] is values for name, values in given.items()):
        return scans
    return Scan(**fields)  # pyright: ignore[reportArgumentType]


def check_columns(fields: Mapping[str, Any], slots: int) -> None:
    """Raise `ValueError` naming the first of stacked scans `(any,)` that is no scan, and why.

    What `Scan.make` demands of all but ranges: angles and limits are finite, the increment is not
    zero nor the beams over a full turn, `0 <= range_min < range_max`, and the slots hold the beams.
    """
    given = [np.asarray(fields[name]) for name in _SCALARS]
    # One array, looked at once: of a single scan, the checks take as long as all else on the host.
    columns = np.array(given, float)
    _, step, low, high, beams = columns
    turn = np.abs(step) * np.maximum(beams - 1, 1)
    demands = (
        *((name, "is not finite") for name in _SCALARS),
        ("beams", f"is not from 0 to {slots}"),
        ("angle_increment", "is zero, or the beams pass 360°"),
        ("range_min", "is negative or not below range_max"),
    )
    met = np.array(
        [
            *np.isfinite(columns),
            (beams >= 0) & (beams <= slots),
            (step != 0) & (turn <= WIDEST),
            (low >= 0) & (low < high),
        ]
    )
    if not met.all():
        demand, index = np.argwhere(~met)[0]
        name, problem = demands[demand]
        value = given[_SCALARS.index(name)][index]
        raise ValueError(f"{name}[{index}]: {value} {problem}")


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


def _numbers(name: str, values: Any) -> np.ndarray:
    """Any kind of real numbers as they are, NaN where they are masked."""
    if isinstance(values, np.ma.MaskedArray):
        return np.ma.filled(values.astype(np.float64), np.nan)
    given = real_numbers(values)
    if given is None:
        raise ValueError(f"{name}: they are not a sequence of real numbers")
    return given


def _single(given: np.ndarray) -> np.ndarray:
    """A copy as float32. A finite value that float32 cannot hold is invalid, not free: NaN."""
    with np.errstate(over="ignore"):
        values = given.astype(np.float32)
    values[np.isinf(values) & np.isfinite(given)] = np.nan
    return values


def _finite(name: str, value: Any) -> np.float32:
    """One number as float32; raises `ValueError` unless it is one, and finite."""
    try:
        if isinstance(value, str | bytes) or np.ndim(value):
            raise TypeError
        with np.errstate(over="ignore"):
            number = np.float32(float(value))
    except (TypeError, ValueError):
        raise ValueError(f"{name}: {shown(value)} is not a number") from None
    except OverflowError:  # a whole number that float64 cannot hold
        number = np.float32(np.inf)
    if not np.isfinite(number):
        raise ValueError(f"{name}: {shown(value)} is not finite in float32")
    return number


def _typed(name: str, values: Any) -> Any:
    """A field of a stack in its documented dtype; the same array where it is of that.

    An array on a device then stays there. Others are of a user's own making, and JAX would promote
    them by its own rules, or refuse to.
    """
    wanted = _DTYPES[name]
    if getattr(values, "dtype", None) == wanted and not isinstance(values, np.ma.MaskedArray):
        return values
    given = _numbers(name, values)
    if wanted == np.float32:
        return _single(given)
    with np.errstate(invalid="ignore"):
        counts = given.astype(np.int32)
    wrong = np.flatnonzero(counts != given)
    if wrong.size:
        raise ValueError(f"{name}[{wrong[0]}]: {given.flat[wrong[0]]} is no number of beams")
    return counts
