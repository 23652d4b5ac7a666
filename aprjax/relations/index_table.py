"""The relationship database as the paper has it: one table of all edges, sorted by length (2.B).

The definition that the histograms of `aprjax.relations.histograms` are tested against, and a
plain NumPy way to look up which references hold an edge of some length.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np


@dataclass(frozen=True)
class IndexTable:
    """All edges of all reference graphs, as tuples (n, e_i) sorted by length d_i."""

    length: np.ndarray
    """`(edges,)` metres, ascending."""
    reference: np.ndarray
    """`(edges,)` the graph n that the edge belongs to."""
    ends: np.ndarray
    """`(edges, 2)` its anchor points p_a and p_b."""
    edges: np.ndarray
    """`(references,)` k_n, the number of edges of each graph."""

    @classmethod
    def build(cls, length: np.ndarray, valid: np.ndarray) -> Self:
        """The table of stacked graphs; both arrays are `(references, anchors, anchors)`."""
        length, valid = np.asarray(length), np.asarray(valid)
        a, b = np.triu_indices(length.shape[-1], k=1)
        reference, edge = np.nonzero(valid[:, a, b])
        found = length[reference, a[edge], b[edge]]
        order = np.argsort(found, kind="stable")
        return cls(
            length=found[order],
            reference=reference[order],
            ends=np.stack([a[edge], b[edge]], axis=-1)[order],
            edges=np.bincount(reference, minlength=length.shape[0]),
        )

    def near(self, length: float, tolerance: float) -> np.ndarray:
        """Rows of the table whose edges are as long as `length` to within `tolerance` metres."""
        low = np.searchsorted(self.length, length - tolerance, side="left")
        high = np.searchsorted(self.length, length + tolerance, side="right")
        return np.arange(low, high)

    def counts(self, lengths: np.ndarray, tolerance: float) -> np.ndarray:
        """c_m: for each reference, its correspondences with the edges of `lengths` `(k_act,)`."""
        counters = np.zeros(len(self.edges), np.int64)
        for length in np.asarray(lengths):
            np.add.at(counters, self.reference[self.near(float(length), tolerance)], 1)
        return counters

    def quality(self, lengths: np.ndarray, tolerance: float) -> np.ndarray:
        """q_m = c_m² / (k_act k_m); zero for graphs without edges."""
        edges = len(lengths) * self.edges
        return np.where(edges > 0, self.counts(lengths, tolerance) ** 2 / np.maximum(edges, 1), 0.0)
