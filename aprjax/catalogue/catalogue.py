"""Scans and their signatures, in blocks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from aprjax.calls import rows_of
from aprjax.evaluation.signature import Discriminant, discriminant, signature
from aprjax.features import FeatureConfig, seen
from aprjax.numerics import bucket, single_precision
from aprjax.references import checked_features, checked_ids, joined
from aprjax.scan import Scan, as_stack

BLOCK = 8192
"""References of a block: they are compared with a query at once."""
_CHUNK = 64  # scans whose signatures are taken at a time, which bounds the memory


@dataclass(frozen=True, eq=False)
class Block:
    """So many references, or fewer in the last one."""

    scans: Scan
    """On the host, `(references, slots)`."""
    signatures: Float[Array, "block size"]
    """On the device; zero where there is no reference."""

    def __len__(self) -> int:
        return self.scans.ranges.shape[0]


@dataclass(frozen=True, eq=False)
class Catalogue:
    """Reference scans with ids 0, 1, … and a signature each. Immutable; `add` gives another one.

    Memory: four bytes for each beam (in buckets) and each entry of a signature, 1.3 kB for a
    reference of 181 beams.
    """

    slots: int
    """Beams that every scan is padded to."""
    config: FeatureConfig
    """How they are described when they are needed."""
    blocks: tuple[Block, ...] = ()
    """All but the last one are full."""

    @classmethod
    def build(
        cls, scans: Sequence[Scan] | Scan, config: FeatureConfig | None = None, *, beams: int = 0
    ) -> Self:
        """The catalogue of these scans, to which scans of so many `beams` can be added.

        `scans` is a list or a stacked `Scan` `(references, slots)`. Raises `ValueError` for none.
        """
        stacked = as_stack(scans)
        slots = bucket(max(stacked.ranges.shape[-1], beams), smallest=64)
        return cls(slots, checked_features(config)).add(stacked)

    def __len__(self) -> int:
        return sum(map(len, self.blocks))

    def add(self, scans: Sequence[Scan] | Scan) -> Self:
        """The catalogue with these scans under the next ids; full blocks are shared, not copied.

        Thousands at a time are quickest. Raises `ValueError` for scans of more beams than the
        catalogue has slots for.
        """
        new = as_stack(scans)
        most = int(np.max(new.beams))
        if most > self.slots:
            raise ValueError(f"scans: {most} beams are more than the catalogue's {self.slots}")
        new = jax.tree.map(np.array, new)  # nobody else's, to stay as they are
        # What is cut off is padding.
        new = eqx.tree_at(lambda scans: scans.ranges, new, new.ranges[:, : self.slots])
        new = new.pad(self.slots)
        signatures = self.signatures(new)
        full = self.blocks
        if full and len(full[-1]) < BLOCK:
            last, full = full[-1], full[:-1]
            new = joined(last.scans, new)
            signatures = np.concatenate([np.asarray(last.signatures)[: len(last)], signatures])
        return replace(
            self,
            blocks=(
                *full,
                *(
                    _block(new, signatures, slice(start, start + BLOCK))
                    for start in range(0, len(signatures), BLOCK)
                ),
            ),
        )

    def signatures(self, scans: Scan) -> Float[np.ndarray, "scans size"]:
        """The signatures of stacked scans, on the host."""
        count = scans.ranges.shape[0]
        size = min(_CHUNK, bucket(count))
        padded = scans.pad_batch(-(-count // size) * size)
        with single_precision():
            chunks = [
                _signatures(
                    rows_of(padded, slice(start, start + size)), self.config, discriminant()
                )
                for start in range(0, count, size)
            ]
        return np.concatenate([np.asarray(chunk) for chunk in chunks])[:count]

    def scans(self, ids: np.ndarray) -> Scan:
        """Copies of the scans of these ids `(any,)`, stacked; raises `ValueError` for no id."""
        ids = checked_ids("ids", ids).astype(np.int64)
        wrong = np.flatnonzero((ids < 0) | (ids >= len(self)))
        if wrong.size:
            raise ValueError(f"ids[{wrong[0]}]: no reference has id {ids[wrong[0]]}")
        order = np.argsort(ids, kind="stable")
        block, row = np.divmod(ids[order], BLOCK)
        numbers = np.unique(block) if ids.size else [0]
        parts = [rows_of(self.blocks[k].scans, row[block == k]) for k in numbers]
        found = jax.tree.map(lambda *arrays: np.concatenate(arrays), *parts)
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        return rows_of(found, back)


def _block(scans: Scan, signatures: np.ndarray, rows: slice) -> Block:
    """The block of some rows."""
    here = signatures[rows]
    padded = np.pad(here, [(0, BLOCK - len(here)), (0, 0)])
    return Block(rows_of(scans, rows), jax.device_put(padded))


@jax.jit
def _signatures(
    scans: Scan, config: FeatureConfig, discriminant: Discriminant
) -> Float[Array, "scans size"]:
    return jax.vmap(lambda scan: signature(seen(scan, config), discriminant))(scans)
