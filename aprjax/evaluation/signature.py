"""What a place looks like from anywhere near: the surfaces of a scan, pair by pair.

Each pair of points on surfaces with a normal has a distance, an angle between the normals, and the
angles of either normal with the line between the points: surflet pairs (Wahl, Hillenbrand and
Hirzinger, 3DIM 2003), of which a histogram depends neither on where nor on how the scanner stands,
but for what it sees. Not in the paper, whose q_m compares lengths of edges between anchors only.

Bins are not equally telling. A linear discriminant (Fisher, Annals of Eugenics 7, 1936) keeps what
tells places apart and drops what changes between scans of one place; `experiments/signature.py`
made it, once and for all, from simulated floors.
"""

from functools import cache
from importlib import resources
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aprjax.evaluation.view import View
from aprjax.numerics import HIGHEST

REACH = 10.0
"""Metres between points, beyond which no pair counts."""
POINTS = 48
"""Points, evenly spread along the surfaces."""
DISTANCES, TURNS, SLANTS = 16, 3, 5
"""Bins of the distance, of the cosine between the normals, of that of a normal and the line.

Odd numbers: right angles, and points on one wall, are in the middle of a bin.
"""
BINS = DISTANCES * TURNS * (SLANTS * (SLANTS + 1) // 2)
_LONGEST = 0.5  # metres of surface that one beam can stand for


class Discriminant(NamedTuple):
    """A linear map of histograms, which keeps what tells places apart."""

    mean: Float[np.ndarray, " bins"]
    axes: Float[np.ndarray, "bins size"]


@cache
def discriminant() -> Discriminant:
    """The one that comes with the package."""
    with resources.files("aprjax.evaluation").joinpath("discriminant.npz").open("rb") as file:
        stored = np.load(file)
        return Discriminant(*(stored[name].astype(np.float32) for name in Discriminant._fields))


def signature(view: View, discriminant: Discriminant) -> Float[Array, " size"]:
    """A vector of length one: the product of two, in [-1, 1], is the likeness of their places.

    Zero throughout for a scan without surfaces.
    """
    pairs = pair_histogram(view)
    kept = jnp.sum((pairs - discriminant.mean)[:, None] * discriminant.axes, axis=0)
    length = jnp.sqrt(jnp.sum(kept * kept))
    return jnp.where(jnp.any(pairs > 0), kept / jnp.maximum(length, 1e-9), 0.0)


def likeness(
    signatures: Float[Array, "*rows size"], other: Float[Array, " size"]
) -> Float[Array, "*rows"]:
    """How like the places of several signatures are to that of another one, in [-1, 1]."""
    return jnp.matmul(signatures, other, precision=HIGHEST)


def pair_histogram(view: View) -> Float[Array, " bins"]:
    """Square roots of the shares of pairs in each bin."""
    xy, normal, real = _spread(view)
    a, b = np.triu_indices(POINTS, k=1)
    line = xy[b] - xy[a]
    distance = jnp.sqrt(jnp.sum(line * line, axis=1))
    along = line / jnp.maximum(distance, 1e-6)[:, None]
    slant_a = _bin(jnp.sum(normal[a] * along, axis=1), SLANTS)
    slant_b = _bin(-jnp.sum(normal[b] * along, axis=1), SLANTS)
    turn = _bin(jnp.sum(normal[a] * normal[b], axis=1), TURNS)
    # A pair has no first point.
    low, high = jnp.minimum(slant_a, slant_b), jnp.maximum(slant_a, slant_b)
    slants = high * (high + 1) // 2 + low
    far = jnp.floor(distance * (DISTANCES / REACH)).astype(jnp.int32)
    number = (far * TURNS + turn) * (SLANTS * (SLANTS + 1) // 2) + slants
    number = jnp.where(real & (far < DISTANCES), number, BINS)
    pairs = jnp.zeros(BINS).at[number].add(1.0, mode="drop")
    return jnp.sqrt(pairs / jnp.maximum(jnp.sum(pairs), 1.0))


def _spread(
    view: View,
) -> tuple[Float[Array, "points 2"], Float[Array, "points 2"], Bool[Array, ""]]:
    """Points evenly spread along the surfaces, their normals, and whether there are any."""
    step = view.xy[1:] - view.xy[:-1]
    gap = jnp.where(view.linked[:-1], jnp.sqrt(jnp.sum(step * step, axis=1)), 0.0)
    length = 0.5 * (jnp.pad(gap, (0, 1)) + jnp.pad(gap, (1, 0)))
    smooth = view.hit & jnp.any(view.normal != 0, axis=1)
    upto = jnp.cumsum(jnp.where(smooth, jnp.minimum(length, _LONGEST), 0.0))
    place = ((np.arange(POINTS) + 0.5) / POINTS).astype(np.float32) * upto[-1]
    entry = jnp.searchsorted(upto, place, method="compare_all")
    entry = jnp.minimum(entry, len(upto) - 1)
    return view.xy[entry], view.normal[entry], upto[-1] > 0


def _bin(cosine: Float[Array, " pairs"], bins: int) -> Int[Array, " pairs"]:
    """Equal parts of [-1, 1]."""
    return jnp.clip(jnp.floor((cosine + 1.0) * (bins / 2)).astype(jnp.int32), 0, bins - 1)
