"""Scans as the kernels that compare two of them take them, and as plain numbers."""

import dataclasses
from typing import Any

import jax
import numpy as np

from aprjax.configuration import Packed
from aprjax.evaluation.view import View
from aprjax.features import FeatureConfig, seen
from aprjax.numerics import bucket, single_precision
from aprjax.scan import Scan


@single_precision()
def view_of(scan: Scan, described_by: Packed[FeatureConfig]) -> View:
    """The view of one scan, on the device; compiles once for each bucket of beams."""
    slots = max(bucket(int(scan.beams)), int(np.shape(scan.ranges)[-1]))
    # On an instance, Equinox would first make a module of the method.
    return _view(Scan.pad(scan, slots), described_by)


@jax.jit
def _view(scan: Scan, described_by: Packed[FeatureConfig]) -> View:
    return seen(scan, described_by.config)


def state_of_scan(scan: Scan) -> dict[str, Any]:
    """A scan as `json` writes it."""
    return {f.name: np.asarray(getattr(scan, f.name)).tolist() for f in dataclasses.fields(scan)}


def scan_of_state(state: dict[str, Any]) -> Scan:
    """The scan that `state_of_scan` made `state` of."""
    arrays: dict[str, Any] = {
        name: np.asarray(value, np.int32 if name == "beams" else np.float32)
        for name, value in state.items()
    }
    return Scan(**arrays)
