"""What a place looks like from anywhere near: the surfaces of a scan, pair by pair.

Each pair of points on surfaces with a normal has a distance, an angle between the normals, and the
angles of either normal with the line between the points: surflet pairs (Wahl, Hillenbrand and
Hirzinger, 3DIM 2003), of which a histogram depends neither on where nor on how the scanner stands,
but for what it sees. Not in the paper, whose q_m compares lengths of edges between anchors only.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.configuration import capacity, threshold
from aprjax.evaluation.view import View


class SignatureConfig(eqx.Module):
    """Which pairs count, and how finely they are told apart."""

    reach: Float[Array, ""] = threshold(10.0, "metres between points, beyond which no pair counts")
    longest: Float[Array, ""] = threshold(0.5, "metres of surface that one beam can stand for")
    points: int = capacity(48, "points, evenly spread along the surfaces")
    distances: int = capacity(16, "bins of the distance")
    turns: int = capacity(3, "bins of the cosine between the normals")
    slants: int = capacity(4, "bins of the cosine between a normal and the line")

    @property
    def size(self) -> int:
        """Entries of a signature."""
        return self.distances * self.turns * (self.slants * (self.slants + 1) // 2)


def signature(view: View, config: SignatureConfig) -> Float[Array, " size"]:
    """Square roots of the shares of pairs in each bin: the product of two is their likeness.

    It is in [0, 1], 1 for equal shares (the Bhattacharyya coefficient). Zero throughout for a
    scan without surfaces.
    """
    xy, normal, real = _spread(view, config)
    a, b = np.triu_indices(config.points, k=1)
    line = xy[b] - xy[a]
    distance = jnp.sqrt(jnp.sum(line * line, axis=1))
    along = line / jnp.maximum(distance, 1e-6)[:, None]
    slant_a = _bin(jnp.sum(normal[a] * along, axis=1), config.slants)
    slant_b = _bin(-jnp.sum(normal[b] * along, axis=1), config.slants)
    turn = _bin(jnp.sum(normal[a] * normal[b], axis=1), config.turns)
    # A pair has no first point.
    low, high = jnp.minimum(slant_a, slant_b), jnp.maximum(slant_a, slant_b)
    slants = high * (high + 1) // 2 + low
    far = jnp.floor(distance * (config.distances / config.reach)).astype(jnp.int32)
    number = (far * config.turns + turn) * (config.slants * (config.slants + 1) // 2) + slants
    number = jnp.where(real & (far < config.distances), number, config.size)
    pairs = jnp.zeros(config.size).at[number].add(1.0, mode="drop")
    return jnp.sqrt(pairs / jnp.maximum(jnp.sum(pairs), 1.0))


def _spread(
    view: View, config: SignatureConfig
) -> tuple[Float[Array, "points 2"], Float[Array, "points 2"], Bool[Array, ""]]:
    """Points evenly spread along the surfaces, their normals, and whether there are any."""
    step = view.xy[1:] - view.xy[:-1]
    gap = jnp.where(view.linked[:-1], jnp.sqrt(jnp.sum(step * step, axis=1)), 0.0)
    length = 0.5 * (jnp.pad(gap, (0, 1)) + jnp.pad(gap, (1, 0)))
    smooth = view.hit & jnp.any(view.normal != 0, axis=1)
    upto = jnp.cumsum(jnp.where(smooth, jnp.minimum(length, config.longest), 0.0))
    place = (jnp.arange(config.points) + np.float32(0.5)) / config.points * upto[-1]
    entry = jnp.minimum(jnp.searchsorted(upto, place), len(upto) - 1)
    return view.xy[entry], view.normal[entry], upto[-1] > 0


def _bin(cosine: Float[Array, " pairs"], bins: int) -> Int[Array, " pairs"]:
    """Equal parts of [-1, 1]."""
    return jnp.clip(jnp.floor((cosine + 1) * (bins / 2)).astype(jnp.int32), 0, bins - 1)
