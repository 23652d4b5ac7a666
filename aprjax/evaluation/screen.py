"""A quick check of many alignments: do either scan's end points lie where the other saw them?

Only alternatives that earned it here get a synthetic scan. No surfaces are joined and nothing is
refined: a thinned set of end points is looked up by bearing in the other view.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.congruence import QualityConfig, Verdicts, quality
from aprjax.evaluation.view import Scanner, View
from aprjax.numerics import safe_norm
from aprjax.se2 import Pose, inverse, transform


class ScreenConfig(eqx.Module):
    """Which end points are looked up, and when they agree."""

    tolerance: Float[Array, ""] = threshold(0.08, "metres off the other scan's range")
    relative: Float[Array, ""] = threshold(0.015, "the same, per metre of range")
    quality: QualityConfig = QualityConfig()
    points: int = capacity(48, "most end points of each scan")


class Sketch(eqx.Module):
    """What the screen needs of a view."""

    scanner: Scanner
    surface: Float[Array, "*batch slots"]
    """Distance of the surface that each entry met in metres; zero where it met none."""
    xy: Float[Array, "*batch points 2"]
    """A few end points in metres."""
    hit: Bool[Array, "*batch points"]


def sketch(view: View, config: ScreenConfig) -> Sketch:
    """The sketch of one view."""
    beam, real = view.thin(config.points)
    surface = jnp.where(view.hit, view.range, 0.0)
    return Sketch(view.scanner, surface, view.xy[beam], view.hit[beam] & real)


def screen(
    references: Sketch,
    row: Int[Array, ""],
    query: Sketch,
    T_ref_query: Pose,
    anchors: Int[Array, ""],
    config: ScreenConfig,
) -> Float[Array, ""]:
    """A rough e_m in [0, 1] of one unrefined alignment; both ways count.

    `row` says which of the stacked sketches is meant. Only what is needed of it is gathered.
    """
    scanner, xy, hit = jax.tree.map(
        lambda array: array[row], (references.scanner, references.xy, references.hit)
    )

    def one_way(
        xy: Float[Array, "points 2"],
        hit: Bool[Array, " points"],
        scanner: Scanner,
        surface: Callable[[Int[Array, " points"]], Float[Array, " points"]],
    ) -> Verdicts:
        """How end points lie in the other view. What lies behind its surfaces says nothing."""
        distance = safe_norm(xy)
        index, visible = scanner.look_up(xy)
        met = surface(index)
        beyond = distance - met
        tolerance = config.tolerance + config.relative * distance
        known = hit & visible & (met > 0)
        agree, contradict = jnp.abs(beyond) <= tolerance, beyond < -tolerance
        return Verdicts.count(known & agree, known & contradict, hit, xy)

    ahead = transform(T_ref_query, query.xy)
    back = transform(inverse(T_ref_query), xy)
    both = jnp.asarray(True)
    return quality(
        one_way(ahead, query.hit, scanner, lambda index: references.surface[row, index]),
        one_way(back, hit, query.scanner, lambda index: query.surface[index]),
        both,
        both,
        anchors,
        config.quality,
    )
