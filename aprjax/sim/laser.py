"""A laser scanner: beams with a width, noise, quantisation, dropouts and mixed pixels."""

from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from aprjax.configuration import capacity, threshold
from aprjax.numerics import bucket, single_precision
from aprjax.scan import WIDEST, Scan, hide_nan, show_nan
from aprjax.se2 import Pose
from aprjax.sim.ray_casting import cast
from aprjax.sim.world import World


class Laser(eqx.Module):
    """A planar scanner; the defaults are a SICK LMS 200 in centimetre mode, as most logs have it.

    Its data sheet states a systematic error of ±15 mm and a statistical one of 5 mm (one sigma),
    both at 1 to 8 m, and a beam 4.4 mrad wide; the other errors' defaults are ours. Here the
    systematic error is one offset for all beams of a scan, uniform within ±`bias`. The
    statistical error is normal, independent for each beam, and of the variance
    `noise`² + (`noise_per_metre` * range)². A beam whose width straddles a depth step reads, with
    probability `mixed`, a distance drawn uniformly between the nearer and the farther surface.

    Raises `ValueError` naming the field and its value where that makes no sense.
    """

    beams: int = capacity(181, "beams of a scan")
    angle_min: Float[Array, ""] = threshold(-np.pi / 2, "radians: bearing of beam 0", least=-np.inf)
    angle_increment: Float[Array, ""] = threshold(
        np.pi / 180, "radians to the next beam", least=-np.inf
    )
    range_min: Float[Array, ""] = threshold(0.02, "metres: anything nearer is too near")
    range_max: Float[Array, ""] = threshold(80.0, "metres: anything farther gives no return")
    resolution: Float[Array, ""] = threshold(
        0.01, "metres between readings; a whole number of them makes a metre"
    )
    bias: Float[Array, ""] = threshold(0.015, "metres: bound of a scan's systematic error")
    noise: Float[Array, ""] = threshold(0.005, "metres: sigma of a beam's error at close range")
    noise_per_metre: Float[Array, ""] = threshold(0.0005, "what range adds to it, metres a metre")
    dropout: Float[Array, ""] = threshold(0.005, "share of beams that are invalid")
    divergence: Float[Array, ""] = threshold(0.0044, "radians: width of a beam")
    mixed: Float[Array, ""] = threshold(
        0.5, "share of the beams on a depth step that read a value between both surfaces"
    )
    mixed_step: Float[Array, ""] = threshold(0.1, "metres: least depth step whose surfaces mix")

    def __check_init__(self) -> None:
        if self.beams < 1:
            raise ValueError(f"beams: {self.beams} is not a positive number")
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return  # within a traced function there are no values to check
        for names, condition, holds in (
            (("angle_min",), "finite", np.isfinite),
            (("angle_increment",), "finite and not zero", lambda v: np.isfinite(v) and v != 0),
            (("range_max",), "in (0, ∞)", lambda v: 0 < v < np.inf),
            (("range_min",), "in [0, range_max)", lambda v: 0 <= v < self.range_max),
            (("resolution",), "a metre divided by a whole number", _divides_a_metre),
            (("bias", "noise", "noise_per_metre", "mixed_step"), "in [0, ∞)", _not_negative),
            (("dropout", "mixed"), "in [0, 1]", lambda v: 0 <= v <= 1),
            (("divergence",), "in [0, π)", lambda v: 0 <= v < np.pi),
        ):
            for name in names:
                if not holds(getattr(self, name)):
                    raise ValueError(f"{name}: {getattr(self, name)} is not {condition}")
        # One beam may repeat: some drivers report both ends of the turn.
        if abs(self.angle_increment) * (self.beams - 1) > WIDEST:
            raise ValueError(
                f"angle_increment: at {self.angle_increment} rad, {self.beams} beams pass 360°"
            )

    @classmethod
    def sick(cls, resolution_deg: float = 1.0, **changes: Any) -> Self:
        """A SICK LMS 200: 181 beams over the front half turn at 1°, or 361 at 0.5°.

        Raises `ValueError` for another resolution. `changes` are other fields' values.
        """
        if resolution_deg not in (0.5, 1.0):
            raise ValueError(f"resolution_deg: {resolution_deg} is neither 0.5 nor 1")
        return cls(
            beams=round(180 / resolution_deg) + 1,
            angle_increment=np.radians(resolution_deg),
            **changes,
        )

    @classmethod
    def full_turn(cls, beams: int = 360, **changes: Any) -> Self:
        """The same scanner looking all around from its back on; no beam is doubled at the seam."""
        step = 2 * np.pi / max(beams, 1)
        return cls(beams=beams, angle_min=-np.pi, angle_increment=step, **changes)  # pyright: ignore[reportArgumentType]


def take_scan(key: PRNGKeyArray, laser: Laser, world: World, T_world_laser: Pose) -> Scan:
    """One scan of `world` from one pose. Pure and traceable; `key` is this scan's own.

    REP 117: +inf beyond `range_max` and where there is no surface, -inf nearer than `range_min`,
    NaN for a dropout. All other ranges are multiples of the laser's resolution.
    """
    keys = jax.random.split(key, 5)
    beam = jnp.arange(laser.beams, dtype=jnp.float32)
    bearings = laser.angle_min + beam * laser.angle_increment
    rays = bearings[:, None] + laser.divergence * jnp.float32([[-0.5, 0.0, 0.5]])
    depths = cast(world, T_world_laser, rays.reshape(-1)).reshape(-1, 3)

    near, far = jnp.min(depths, axis=1), jnp.max(depths, axis=1)
    mixes = _on_depth_step(depths, laser) & _chance(keys[0], laser.mixed, beam)
    between = near + jax.random.uniform(keys[1], beam.shape) * (far - near)
    depth = jnp.where(mixes, between, depths[:, 1])

    offset = laser.bias * jax.random.uniform(keys[2], minval=-1.0, maxval=1.0)
    sigma = jnp.hypot(laser.noise, laser.noise_per_metre * jnp.minimum(depth, laser.range_max))
    measured = depth + offset + sigma * jax.random.normal(keys[3], beam.shape)
    # Divided by a whole number, a range is the float32 nearest to the decimals a log would hold.
    steps_per_metre = jnp.round(1.0 / laser.resolution)
    ranges = jnp.round(measured * steps_per_metre) / steps_per_metre

    ranges = jnp.where(ranges > laser.range_max, jnp.inf, ranges)
    ranges = jnp.where(ranges < laser.range_min, -jnp.inf, ranges)
    ranges = jnp.where(_chance(keys[4], laser.dropout, beam), jnp.nan, ranges)
    return Scan(
        ranges=ranges,
        angle_min=jnp.asarray(laser.angle_min),
        angle_increment=jnp.asarray(laser.angle_increment),
        range_min=jnp.asarray(laser.range_min),
        range_max=jnp.asarray(laser.range_max),
        beams=jnp.int32(laser.beams),
    )


_CHUNK = 32  # scans taken at a time, which bounds the memory


@single_precision()
def take_scans(
    key: PRNGKeyArray,
    laser: Laser,
    world: World,
    moving: np.ndarray | None,
    T_world_laser: np.ndarray,
) -> Scan:
    """Scans from poses `T_world_laser` `(N, 3)`, stacked on the host, with `beams` slots.

    `moving` `(N, M, 3)` are circles that only the scan of that number sees, such as people's
    legs. Scan i draws its random numbers from `key` folded with i, whatever else is taken with
    it. Compiles once for each number of beams and bucket of surfaces. Raises `ValueError` naming
    the field, index and value if a shape does not fit or a number is not finite.
    """
    poses = _finite("T_world_laser", T_world_laser, 2)
    count = len(poses)
    circles = _finite("moving", np.zeros((count, 0, 3)) if moving is None else moving, 3)
    if count == 0:
        raise ValueError("T_world_laser: there are no poses")
    if len(circles) != count:
        raise ValueError(f"moving: circles of {len(circles)} scans, but there are {count} poses")
    world = World.make(world.segments, world.circles)  # pyright: ignore[reportArgumentType]
    world = world.pad(
        bucket(world.segments.shape[0], smallest=64), bucket(world.circles.shape[0], smallest=64)
    )
    more = -count % _CHUNK
    poses = np.pad(poses, [(0, more), (0, 0)])
    legs = bucket(circles.shape[1]) - circles.shape[1]
    circles = np.pad(circles, [(0, more), (0, legs), (0, 0)])
    chunks = [
        _take_chunk(
            key,
            np.int32(start),
            laser,
            world,
            circles[start : start + _CHUNK],
            poses[start : start + _CHUNK],
        )
        for start in range(0, count, _CHUNK)
    ]
    return show_nan(*jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *chunks))


@jax.jit
def _take_chunk(
    key: PRNGKeyArray,
    first: Int[Array, ""],
    laser: Laser,
    world: World,
    moving: Float[Array, "chunk moving 3"],
    T_world_laser: Float[Array, "chunk 3"],
) -> tuple[Scan, Bool[Array, "chunk beams"]]:
    """Scans number `first` and on, and which of their readings are NaN."""

    def one(index, moving, T_world_laser):
        around = World(world.segments, jnp.concatenate([world.circles, moving]))
        return take_scan(jax.random.fold_in(key, index), laser, around, T_world_laser)

    return hide_nan(jax.vmap(one)(first + jnp.arange(_CHUNK), moving, T_world_laser))


def _on_depth_step(depths: Float[Array, "beams 3"], laser: Laser) -> Bool[Array, " beams"]:
    """Whether the sides and the centre of a beam, all hits, lie on surfaces a step apart.

    On one plane, 1 / range is a sinusoid of the bearing, so the sides tell the range of the
    centre, however shallow the incidence. A step, short against the range, puts it off by half
    the step, or by all of it where it lies on either side of the centre.
    """
    right, centre, left = depths[:, 0], depths[:, 1], depths[:, 2]
    plane = 2 * jnp.cos(laser.divergence / 2) * right * left / (right + left)
    apart = jnp.max(depths, axis=1) - jnp.min(depths, axis=1)
    step = jnp.minimum(apart, 2 * jnp.abs(centre - plane))
    return jnp.all(depths <= laser.range_max, axis=1) & (step > laser.mixed_step)


def _chance(
    key: PRNGKeyArray, share: Float[Array, ""], beam: Float[Array, " beams"]
) -> Bool[Array, " beams"]:
    """True for a random `share` of the beams."""
    return jax.random.uniform(key, beam.shape) < share


def _finite(name: str, values: np.ndarray, axes: int) -> np.ndarray:
    """Poses or circles `(..., 3)` of so many axes in float32, checked."""
    array = np.asarray(values, np.float32)
    if array.ndim != axes or array.shape[-1] != 3:
        raise ValueError(f"{name}: shape {array.shape} has not {axes} axes, the last of length 3")
    wrong = np.argwhere(~np.isfinite(array))
    if wrong.size:
        index = tuple(wrong[0].tolist())
        raise ValueError(f"{name}[{', '.join(map(str, index))}]: {array[index]} is not finite")
    return array


def _not_negative(value: np.ndarray) -> bool:
    return bool(0 <= value < np.inf)


def _divides_a_metre(value: np.ndarray) -> bool:
    return bool(value > 0 and abs(np.rint(1 / value) * value - 1) < 1e-5)
