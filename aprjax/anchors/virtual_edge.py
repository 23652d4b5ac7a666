"""Virtual edge anchors: where the elongations of large straight surfaces meet (paper 2.A).

No lines are extracted from the sweep. A histogram of surface directions, weighted by length,
shows the directions of the large surfaces; along each, a histogram of offsets shows where they
lie, however often they are interrupted.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from aprjax.anchors.angle import intersection
from aprjax.anchors.candidates import Candidates, Kind
from aprjax.anchors.segment import Segments
from aprjax.anchors.surface import Surface
from aprjax.configuration import capacity, threshold
from aprjax.numerics import first_max, safe_arctan2, sums, wrap


class VirtualEdgeConfig(eqx.Module):
    """Which surfaces are large and straight, and how far they are elongated."""

    min_length: Float[Array, ""] = threshold(0.5, "metres of visible surface on one line")
    max_rms: Float[Array, ""] = threshold(0.05, "metres: roughness of surface that votes")
    width: Float[Array, ""] = threshold(
        0.1, "metres that a surface may lie off its line", least=0.001
    )
    spread: Float[Array, ""] = threshold(0.2, "radians that it may be turned off its line")
    min_angle: Float[Array, ""] = threshold(
        0.5, "radians between two lines that meet", most=np.pi / 2
    )
    elongation: Float[Array, ""] = threshold(4.0, "metres beyond the visible surface", least=0.001)
    weight: Float[Array, ""] = threshold(1.2, "salience where two lines of 2 m meet")
    directions: int = capacity(4, "directions of surfaces")
    lines: int = capacity(4, "lines for each direction")
    direction_bins: int = capacity(90, "histogram bins over half a turn")
    offset_bins: int = capacity(800, "bins of half a width: lines within 20 m of the laser")


class Lines(eqx.Module):
    """Straight surfaces as lines with the stretch on which they were seen."""

    centre: Float[Array, "lines 2"]
    """Metres."""
    direction: Float[Array, " lines"]
    """Radians."""
    low: Float[Array, " lines"]
    """Metres from the centre along the direction: start of the visible stretch."""
    high: Float[Array, " lines"]
    """Its end."""
    length: Float[Array, " lines"]
    """Metres of visible surface; the stretch may have gaps."""
    valid: Bool[Array, " lines"]


def virtual_edges(segments: Segments, surface: Surface, config: VirtualEdgeConfig) -> Candidates:
    """One candidate for each two lines."""
    lines = surface_lines(segments, surface, config)
    a, b = np.triu_indices(lines.length.shape[0], k=1)
    xy, sine = intersection(
        lines.centre[a], lines.direction[a], lines.centre[b], lines.direction[b]
    )
    beyond = jnp.maximum(_beyond(lines, a, xy), _beyond(lines, b, xy))
    length = jnp.minimum(lines.length[a], lines.length[b])
    valid = (
        lines.valid[a]
        & lines.valid[b]
        & (jnp.abs(sine) >= jnp.sin(config.min_angle))
        & (beyond <= jnp.minimum(config.elongation, 2 * length))
    )
    certain = jnp.minimum(length, 2.0) / 2.0 / (1.0 + beyond / config.elongation)
    return Candidates(
        xy=xy,
        kind=jnp.full(valid.shape, Kind.VIRTUAL_EDGE.value, jnp.int32),
        salience=config.weight * jnp.abs(sine) * certain,
        valid=valid,
    )


def surface_lines(segments: Segments, surface: Surface, config: VirtualEdgeConfig) -> Lines:
    """The large straight surfaces of one scan: `directions * lines` of them, not all valid."""
    face = surface.through
    unit = jnp.stack([jnp.cos(face.direction), jnp.sin(face.direction)], axis=-1)
    index = jnp.arange(face.direction.shape[0])
    chord = (
        segments.xy[index + jnp.minimum(segments.after, 1)]
        - segments.xy[index - jnp.minimum(segments.before, 1)]
    )
    straight = segments.large & (face.rms <= config.max_rms) & (face.count >= 5)
    length = jnp.where(straight, 0.5 * jnp.abs(jnp.sum(chord * unit, axis=-1)), 0.0)

    angles = _peak_directions(face.direction, length, config)

    def along(angle):
        return _lines_along(angle, segments.xy, face.direction, length, config)

    found = jax.vmap(along)(angles)
    return jax.tree.map(lambda array: array.reshape(-1, *array.shape[2:]), found)


def _peak_directions(
    direction: Float[Array, " slots"], length: Float[Array, " slots"], config: VirtualEdgeConfig
) -> Float[Array, " directions"]:
    """The directions, in radians, along which most length of surface runs."""
    width = np.pi / config.direction_bins
    bins = jnp.floor((direction + np.pi / 2) / width).astype(jnp.int32) % config.direction_bins
    histogram = jnp.zeros(config.direction_bins).at[bins].add(length)
    histogram = histogram + jnp.roll(histogram, 1) + jnp.roll(histogram, -1)
    middle = (jnp.arange(config.direction_bins).astype(jnp.float32) + 0.5) * width - np.pi / 2

    def choose(histogram, _):
        angle = middle[first_max(histogram)]
        near = jnp.abs(wrap(middle - angle, np.pi)) <= config.spread
        return jnp.where(near, 0.0, histogram), angle

    _, angle = jax.lax.scan(choose, histogram, length=config.directions)
    gap = wrap(direction[None, :] - angle[:, None], np.pi)
    weight = jnp.where(jnp.abs(gap) <= 2 * width, length[None, :], 0.0)
    return angle + jnp.sum(weight * gap, axis=-1) / jnp.maximum(jnp.sum(weight, axis=-1), 1e-6)


def _lines_along(
    angle: Float[Array, ""],
    xy: Float[Array, "slots 2"],
    direction: Float[Array, " slots"],
    length: Float[Array, " slots"],
    config: VirtualEdgeConfig,
) -> Lines:
    """The strongest lines in the direction `angle` (radians)."""
    unit = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
    offset = xy[:, 1] * unit[0] - xy[:, 0] * unit[1]
    parallel = jnp.abs(wrap(direction - angle, np.pi)) <= config.spread
    length = jnp.where(parallel, length, 0.0)
    bin_width = 0.5 * config.width
    half = config.offset_bins // 2
    bins = jnp.clip(
        jnp.floor(offset / bin_width).astype(jnp.int32) + half, 0, config.offset_bins - 1
    )
    histogram = jnp.zeros(config.offset_bins).at[bins].add(length)
    histogram = histogram.at[jnp.array([0, -1])].set(0.0)
    histogram = histogram + jnp.roll(histogram, 1) + jnp.roll(histogram, -1)
    middle = (jnp.arange(-half, config.offset_bins - half).astype(jnp.float32) + 0.5) * bin_width

    def choose(histogram, _):
        peak = middle[first_max(histogram)]
        return jnp.where(jnp.abs(middle - peak) <= 1.5 * config.width, 0.0, histogram), peak

    _, peaks = jax.lax.scan(choose, histogram, length=config.lines)

    def line(peak):
        weight = jnp.where(jnp.abs(offset - peak) <= config.width, length, 0.0)
        total = jnp.sum(weight)
        share = weight / jnp.maximum(total, 1e-6)
        centre = jnp.stack(sums(share * xy[:, 0], share * xy[:, 1]))
        x, y = xy[:, 0] - centre[0], xy[:, 1] - centre[1]
        xx, yy, cross = sums(*(share * product for product in (x * x, y * y, x * y)))
        fitted = 0.5 * safe_arctan2(2 * cross, xx - yy)
        along = x * jnp.cos(fitted) + y * jnp.sin(fitted)
        return Lines(
            centre=centre,
            direction=fitted,
            low=jnp.min(jnp.where(weight > 0, along, 0.0)),
            high=jnp.max(jnp.where(weight > 0, along, 0.0)),
            length=total,
            valid=total >= config.min_length,
        )

    return jax.vmap(line)(peaks)


def _beyond(lines: Lines, index: np.ndarray, xy: Float[Array, "pairs 2"]) -> Float[Array, " pairs"]:
    """How many metres past the visible stretch of its line each point lies."""
    gap = xy - lines.centre[index]
    along = gap[:, 0] * jnp.cos(lines.direction[index]) + gap[:, 1] * jnp.sin(
        lines.direction[index]
    )
    return jnp.maximum(jnp.maximum(along - lines.high[index], lines.low[index] - along), 0.0)
