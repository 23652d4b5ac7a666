"""Describing many scans: on the host, in jitted calls."""

import jax
import numpy as np

from aprjax.calls import in_calls, rows_of, size_of_calls
from aprjax.configuration import Packed
from aprjax.features import FeatureConfig, Features, describe
from aprjax.programs import Program
from aprjax.scan import Scan


def _describe_chunk(scans: Scan, described_by: Packed[FeatureConfig]) -> Features:
    return jax.vmap(describe, (0, None))(scans, described_by.config)


describe_chunk = Program(_describe_chunk, Features)
"""The features of stacked scans, on the device. References and queries share what is compiled."""


def described(scans: Scan, config: FeatureConfig) -> Features:
    """Features of stacked scans, on the host.

    Put together by NumPy: eager jax operations would compile for every number of scans.
    """
    count = scans.ranges.shape[0]
    size, described_by = size_of_calls(count), Packed.of(config)

    def work(start: int) -> Features:
        rows = slice(start, start + size)
        # On an instance, Equinox would first make a module of the method.
        chunk = Scan.pad_batch(rows_of(scans, rows), size)
        return jax.device_get(describe_chunk(chunk, described_by))

    chunks = in_calls(work, max(count, 1), size)
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *chunks)
