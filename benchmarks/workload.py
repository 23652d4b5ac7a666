"""What a benchmark measures, and what came of it. Less is better, for all of them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchmarks.machine import Probe


class Skipped(Exception):  # noqa: N818
    """Why a workload cannot be measured here."""


@dataclass(frozen=True)
class Metric:
    """A quantile of a workload's samples, and how far it may grow past its baseline."""

    name: str
    share: float
    """0.5 is the median."""
    tolerance: float
    """A share of the baseline, in normalised figures."""


@dataclass(frozen=True)
class Samples:
    """Single measurements, in the workload's unit."""

    values: np.ndarray
    note: str = ""


@dataclass(frozen=True)
class Workload:
    """Something whose time is of interest."""

    name: str
    what: str
    """In words."""
    unit: str
    metrics: tuple[Metric, ...]
    measure: Callable[[bool], Samples]
    """Told whether to be quick: fewer repeats of the same work. Raises `Skipped`."""
    cores: Literal["one", "all"] = "one"
    """Which figure of the probe it is normalised by."""


@dataclass(frozen=True)
class Figure:
    """One metric of one workload, measured."""

    workload: str
    metric: str
    unit: str
    value: float
    low: float
    """10th percentile of the samples, whatever the metric."""
    high: float
    """90th percentile."""
    samples: int
    slowness: float
    """Of this machine at that time: 1 is the nominal machine of `benchmarks.machine`."""
    tolerance: float
    note: str = ""
    direction: str = "lower"

    @property
    def normalised(self) -> float:
        """What the nominal machine would need."""
        return self.value / self.slowness

    @property
    def name(self) -> str:
        """Workload and metric."""
        return f"{self.workload} {self.metric}"


def figures(workload: Workload, samples: Samples, probes: list[Probe]) -> list[Figure]:
    """The metrics of a workload, with the machine's speed as probed before and after it."""
    slowness = float(np.mean([probe.slowness(workload.cores) for probe in probes]))
    low, high = np.percentile(samples.values, [10, 90])
    return [
        Figure(
            workload=workload.name,
            metric=metric.name,
            unit=workload.unit,
            value=float(np.quantile(samples.values, metric.share)),
            low=float(low),
            high=float(high),
            samples=len(samples.values),
            slowness=slowness,
            tolerance=metric.tolerance,
            note=samples.note,
        )
        for metric in workload.metrics
    ]
