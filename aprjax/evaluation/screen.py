"""A quick check of many alignments: do either scan's end points lie where the other saw them?

Only alternatives that earned it here get a synthetic scan. No surfaces are joined and nothing is
refined here: a thinned set of end points is looked up by bearing in the other view.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.congruence import QualityConfig, Verdicts, quality
from aprjax.evaluation.view import Scanner, View
from aprjax.numerics import arctan2, take
from aprjax.se2 import Pose


class SketchConfig(eqx.Module):
    """Which end points are looked up."""

    points: int = capacity(48, "most end points of a scan")


class ScreenConfig(eqx.Module):
    """When end points agree, and what that is worth."""

    tolerance: Float[Array, ""] = threshold(0.08, "metres off the other scan's range")
    relative: Float[Array, ""] = threshold(0.015, "the same, per metre of range")
    quality: QualityConfig = QualityConfig()


class Sketch(eqx.Module):
    """What the screen needs of a view."""

    scanner: Scanner
    surface: Float[Array, "*batch slots"]
    """Distance of the surface that each entry met in metres; zero where it met none."""
    x: Float[Array, "*batch points"]
    """Of a few end points in metres."""
    y: Float[Array, "*batch points"]
    hit: Bool[Array, "*batch points"]


def sketch(view: View, config: SketchConfig) -> Sketch:
    """The sketch of one view."""
    beam, real = view.thin(config.points)
    surface = jnp.where(view.hit, view.range, 0.0)
    x, y = view.xy[beam, 0], view.xy[beam, 1]
    return Sketch(view.scanner, surface, x, y, view.hit[beam] & real)


def screen(
    references: Sketch,
    row: Int[Array, ""],
    query: Sketch,
    T_ref_query: Pose,
    anchors: Int[Array, ""],
    config: ScreenConfig,
) -> Float[Array, ""]:
    """A rough e_m in [0, 1] of one alignment; both ways count.

    `row` says which of the stacked sketches is meant. Only what is needed of it is gathered.
    """
    scanner, theirs_x, theirs_y, theirs_hit = jax.tree.map(
        lambda array: array[row],
        (references.scanner, references.x, references.y, references.hit),
    )

    def one_way(
        x: Float[Array, " points"],
        y: Float[Array, " points"],
        hit: Bool[Array, " points"],
        scanner: Scanner,
        surfaces: Float[Array, " entries"],
        first: Int[Array, ""],
    ) -> Verdicts:
        """How end points lie in the other view, whose surfaces begin at `first`.

        What lies behind them says nothing.
        """
        distance = jnp.sqrt(x * x + y * y)
        index, visible = scanner.towards(arctan2(y, x))
        met = take(surfaces, first + index)
        beyond = distance - met
        tolerance = config.tolerance + config.relative * distance
        known = hit & visible & (met > 0)
        agree, contradict = jnp.abs(beyond) <= tolerance, beyond < -tolerance
        return Verdicts.count(known & agree, known & contradict, hit, x, y)

    # Coordinate by coordinate: XLA on a CPU does not vectorise so short an axis.
    x, y = T_ref_query[0], T_ref_query[1]
    cos, sin = jnp.cos(T_ref_query[2]), jnp.sin(T_ref_query[2])
    dx, dy = theirs_x - x, theirs_y - y
    ahead = one_way(
        cos * query.x - sin * query.y + x,
        sin * query.x + cos * query.y + y,
        query.hit,
        scanner,
        references.surface.reshape(-1),
        row * references.surface.shape[-1],
    )
    back = one_way(
        cos * dx + sin * dy,
        cos * dy - sin * dx,
        theirs_hit,
        query.scanner,
        query.surface,
        jnp.int32(0),
    )
    both = jnp.asarray(True)
    return quality(ahead, back, both, both, anchors, config.quality)
