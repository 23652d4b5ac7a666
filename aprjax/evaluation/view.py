"""What a scanner saw from one place: ranges by bearing, surfaces and their normals.

The common ground of synthetic scans, congruence and refinement. Any point of the plane can be
looked up in a view by its bearing: it is on the surface seen there, before it, or hidden.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.anchors.segment import Segments
from aprjax.anchors.surface import Surface
from aprjax.configuration import threshold
from aprjax.numerics import arctan2
from aprjax.scan import Scan


class ViewConfig(eqx.Module):
    """Which surfaces have a normal."""

    max_rms: Float[Array, ""] = threshold(0.05, "metres: roughness of a surface with a normal")


class View(eqx.Module):
    """One scan in the order of the sweep, a full turn unrolled as in `Segments`."""

    xy: Float[Array, "*batch slots 2"]
    """Hit points in metres; zero where there is none."""
    range: Float[Array, "*batch slots"]
    """Metres; the range limit for no return, zero where nothing is known."""
    hit: Bool[Array, "*batch slots"]
    linked: Bool[Array, "*batch slots"]
    """This hit and the next are on the same surface."""
    normal: Float[Array, "*batch slots 2"]
    """Unit normal of the surface; zero where it has none."""
    angle_min: Float[Array, "*batch"]
    """Bearing of the first entry in radians."""
    angle_increment: Float[Array, "*batch"]
    beams: Int[Array, "*batch"]
    full_turn: Bool[Array, "*batch"]

    @property
    def bearings(self) -> Float[Array, " slots"]:
        """Directions of the entries in radians."""
        steps = jnp.arange(self.xy.shape[-2]).astype(jnp.float32)
        return self.angle_min + steps * self.angle_increment

    def thin(self, size: int) -> tuple[Int[Array, " size"], Bool[Array, " size"]]:
        """At most `size` entries evenly spread over the beams, and which of them are real.

        They depend on the number of beams, not of slots: padding changes nothing.
        """
        size = min(size, self.xy.shape[-2])
        k = jnp.arange(size)
        # Nothing is negative: `//` would have the rounding of what is compiled, too.
        return jnp.where(self.beams > size, jax.lax.div(k * self.beams, size), k), k < self.beams

    def pad(self, slots: int) -> "View":
        """The same view with `slots` entries; those added at the end are no hits.

        Raises `ValueError` if it has more.
        """
        missing = slots - self.range.shape[-1]
        if missing < 0:
            raise ValueError(f"slots: {slots} is fewer than the {slots - missing} there are")

        def pad(array: Array) -> Array:
            batch = self.range.ndim - 1
            width = [(0, 0)] * batch + [(0, missing)] + [(0, 0)] * (array.ndim - batch - 1)
            return jnp.pad(array, width)

        names = ("xy", "range", "hit", "linked", "normal")
        return replace(self, **{name: pad(getattr(self, name)) for name in names})

    @property
    def scanner(self) -> "Scanner":
        """The directions of the entries."""
        return Scanner(self.angle_min, self.angle_increment, self.beams, self.full_turn)

    def look_up(
        self, xy: Float[Array, "points 2"]
    ) -> tuple[Int[Array, " points"], Bool[Array, " points"]]:
        """The entry nearest in bearing to each point, and whether it is in the field of view."""
        return self.scanner.look_up(xy)


def facing(reference: View, query: View) -> tuple[View, View]:
    """The overviews and the fronts of both ways, ahead and back, each stacked.

    For one mapped function: half as much for XLA to compile, and to run one after the other.
    """
    slots = max(reference.range.shape[-1], query.range.shape[-1])
    overviews = jax.tree.map(lambda *pair: jnp.stack(pair), reference.pad(slots), query.pad(slots))
    return overviews, jax.tree.map(lambda array: array[::-1], overviews)


class Scanner(eqx.Module):
    """In which directions a scanner looked."""

    angle_min: Float[Array, "*batch"]
    angle_increment: Float[Array, "*batch"]
    beams: Int[Array, "*batch"]
    full_turn: Bool[Array, "*batch"]

    def look_up(
        self, xy: Float[Array, "points 2"]
    ) -> tuple[Int[Array, " points"], Bool[Array, " points"]]:
        """The entry nearest in bearing to each point, and whether it is in the field of view."""
        return self.towards(arctan2(xy[:, 1], xy[:, 0]))

    def towards(
        self, bearing: Float[Array, " points"]
    ) -> tuple[Int[Array, " points"], Bool[Array, " points"]]:
        """The same for bearings in radians; the entry is one of the view, whatever the bearing."""
        width = jnp.abs(self.angle_increment)
        # Half a beam before the first one is still in view.
        turned = (bearing - self.angle_min) * jnp.sign(self.angle_increment) + 0.5 * width
        turned = turned - 2 * np.pi * jnp.floor(turned / (2 * np.pi))
        step = jnp.floor(turned / width).astype(jnp.int32)
        step = jnp.where(self.full_turn & (step >= self.beams), 0, step)
        return jnp.clip(step, 0, jnp.maximum(self.beams - 1, 0)), step < self.beams


def view(scan: Scan, segments: Segments, surface: Surface, config: ViewConfig) -> View:
    """The view of one segmented scan: what was measured, and nothing that was filled in."""
    hit = segments.hit & scan.hit[segments.beam]
    range_ = jnp.where(jnp.isinf(segments.range), scan.range_max, segments.range)
    through = surface.through
    smooth = hit & (through.count >= 4) & (through.rms <= config.max_rms)
    normal = jnp.stack([-jnp.sin(through.direction), jnp.cos(through.direction)], axis=-1)
    return View(
        xy=jnp.where(hit[:, None], segments.xy, 0.0),
        range=jnp.where(segments.hit & ~hit, 0.0, range_),
        hit=hit,
        linked=hit & (segments.after > 0) & jnp.roll(hit, -1),
        normal=jnp.where(smooth[:, None], normal, 0.0),
        angle_min=segments.angle_min,
        angle_increment=segments.angle_increment,
        beams=scan.beams * jnp.ones((), jnp.int32),
        full_turn=scan.full_turn,
    )
