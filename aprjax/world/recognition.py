"""Which scans of a drive look like earlier ones: the matcher's global answers, scan by scan.

An answer alone closes no cycle. `closure` looks for several that agree.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aprjax.batch import match_batch
from aprjax.calls import rows_of
from aprjax.configuration import capacity, threshold
from aprjax.matcher import MatchConfig
from aprjax.plane import distance, wrap
from aprjax.references import ReferenceSet
from aprjax.world.motion import Motion

_BATCH = 64  # queries of one call to the matcher


class RecognitionConfig(eqx.Module):
    """Which scans are compared with which, and what answers are kept."""

    match: MatchConfig = MatchConfig(hypotheses=8)
    gap: Float[Array, ""] = threshold(1.5, "metres between scans that others are compared with")
    turn: Float[Array, ""] = threshold(np.radians(40), "radians, likewise")
    query_gap: Float[Array, ""] = threshold(0.5, "metres between scans that are compared")
    query_turn: Float[Array, ""] = threshold(np.radians(15), "radians, likewise")
    age: Float[Array, ""] = threshold(15.0, "metres of way after which a scan may be recognized")
    quality: Float[Array, ""] = threshold(0.04, "least e_m of an answer that is kept")
    batch: int = capacity(_BATCH, "scans matched in one call")


@dataclass(frozen=True, eq=False)
class Sightings:
    """Answers of the matcher, by the number of the scan that was compared."""

    scan: np.ndarray
    """`(S,)` ascending."""
    earlier: np.ndarray
    """`(S,)` the earlier scan that it looks like."""
    T_earlier_scan: np.ndarray
    """`(S, 3)` metres, radians."""
    quality: np.ndarray
    """`(S,)` e_m."""

    def of(self, first: int, last: int) -> np.ndarray:
        """Indices of the answers to scans `first` to `last`, both included."""
        low, high = np.searchsorted(self.scan, [first, last + 1])
        return np.arange(low, high)


def sightings(
    described: ReferenceSet,
    moved: Motion,
    config: RecognitionConfig,
    progress: Callable[[int], None] | None = None,
) -> Sightings:
    """Compare scans of a drive with all those far enough before them on the way.

    `described` holds all scans of the drive under their numbers. `progress` is told how many more
    scans have been dealt with.
    """
    kept = spaced(moved.poses, float(config.gap), float(config.turn))
    compared = spaced(moved.poses, float(config.query_gap), float(config.query_turn))
    earlier = described.remove(np.setdiff1d(described.ids, kept))
    rows: list[tuple[np.ndarray, ...]] = []
    old = np.searchsorted(moved.way, moved.way - config.age)
    for start in range(0, len(compared), config.batch):
        batch = compared[start : start + config.batch]
        if np.any(kept < old[batch[-1]]):
            known = _before(earlier, int(old[batch[-1]]))
            rows.append(_answers(described, known, batch, old[batch], config))
        if progress is not None:
            ended = start + config.batch >= len(compared)
            last = len(moved.poses) if ended else int(compared[start + config.batch])
            progress(last - int(batch[0]))
    if not rows:
        return Sightings(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), np.zeros(0))
    return Sightings(*map(np.concatenate, zip(*rows, strict=True)))


def spaced(poses: np.ndarray, gap: float, turn: float) -> np.ndarray:
    """Numbers of the poses that lie `gap` metres or `turn` radians from the last one taken."""
    taken = [0]
    for number, pose in enumerate(poses):
        step = pose - poses[taken[-1]]
        if distance(step) > gap or abs(wrap(step[2])) > turn:
            taken.append(number)
    return np.array(taken)


def _before(references: ReferenceSet, number: int) -> ReferenceSet:
    """Only the references below an id, in arrays of the same size: nothing compiles anew."""
    index = references.index
    ids = np.asarray(index.ids)
    hidden = jnp.asarray(np.where(ids < number, ids, -1))
    return replace(references, index=eqx.tree_at(lambda i: i.ids, index, hidden))


def _answers(
    described: ReferenceSet,
    earlier: ReferenceSet,
    numbers: np.ndarray,
    old: np.ndarray,
    config: RecognitionConfig,
) -> tuple[np.ndarray, ...]:
    """The columns of `Sightings` for a batch of scans.

    Of the `earlier` ones, those below `old` may answer each.
    """
    batch = rows_of(described.scans, numbers)
    young = _young(np.asarray(earlier.index.ids), old, config.batch)
    result = match_batch(batch.pad_batch(config.batch), earlier, config.match, exclude=young)
    result = jax.tree.map(lambda array: array[: len(numbers)], result)
    query, rank = np.nonzero(result.valid & (result.quality >= config.quality))
    return (
        numbers[query],
        np.asarray(result.reference[query, rank], int),
        np.asarray(result.T_ref_query[query, rank], float),
        np.asarray(result.quality[query, rank], float),
    )


def _young(ids: np.ndarray, old: np.ndarray, batch: int) -> np.ndarray:
    """The `ids` that are not below `old` `(queries,)`, for each query of a batch; -1 for none.

    `(batch, any)`, at least as many as mostly are needed: another size would compile anew.
    """
    own = [ids[ids >= first] for first in old]
    young = np.full((batch, max(batch, *map(len, own))), -1)
    for row, some in zip(young, own, strict=False):
        row[: len(some)] = some
    return young
