"""Sources and what they answer, made sure of: whatever they say, the tracker goes on."""

import logging
import operator
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import numpy as np

from aprjax.tracking.hypothesis import Step
from aprjax.tracking.sources import Estimate, Verdict
from aprjax.world.model import WorldModel
from aprjax.world.parts import Place

_log = logging.getLogger(__name__)

_Source = TypeVar("_Source")

_FARTHEST = 1e9  # metres, radians, m²: beyond it no number of a source is believed


def checked_sources(name: str, sources: Iterable[_Source], method: str) -> tuple[_Source, ...]:
    """The sources. Raises `ValueError` naming one without `reads` or without the method."""
    if not isinstance(sources, Iterable):
        raise ValueError(f"{name}: {type(sources).__name__} is no list of sources")
    sources = tuple(sources)
    for index, source in enumerate(sources):
        if isinstance(source, type):
            raise ValueError(f"{name}[{index}]: {source.__name__} is a class, not an instance")
        if not isinstance(getattr(source, "reads", None), str):
            raise ValueError(f"{name}[{index}]: {type(source).__name__} does not say what it reads")
        if not callable(getattr(source, method, None)):
            raise ValueError(f"{name}[{index}]: {type(source).__name__} has no method {method}")
    return sources


def checked_step(step: Step) -> Step:
    """The step in plain numbers. Raises `ValueError` unless it can be one."""
    covariance = np.array(step.covariance, float)
    if covariance.shape != (3, 3):
        raise ValueError(f"no sound step: {step}")
    known = np.isfinite(np.diag(covariance))
    both = np.outer(known, known)
    unmeasured = np.isposinf(np.diag(covariance))
    if not (
        np.all(known | unmeasured)
        and _is_covariance(np.where(both, covariance, 0.0))
        and 0.0 <= step.doubt <= 1.0
    ):
        raise ValueError(f"no sound step: {step}")
    covariance = np.where(both, covariance, np.diag(np.where(known, 0.0, np.inf)))
    T = np.where(known, np.array(step.T_before_now, float), 0.0)
    return Step(_numbers(T, "step"), covariance, float(step.doubt))


def checked_estimates(found: Sequence[Estimate], world: WorldModel) -> list[Estimate]:
    """The estimates that can be true, in plain numbers; others are logged and left out.

    Raises for what is no estimate at all.
    """
    known = []
    for estimate in found:
        try:
            place = _checked_place(estimate.place, world)
            covariance = np.array(estimate.covariance, float)
            if not (_is_covariance(covariance) and 0.0 <= estimate.probability <= 1.0):
                raise ValueError("no sound numbers")
            probability = float(estimate.probability)
            known.append(Estimate(place, covariance, probability, _id(estimate.reference)))
        except (TypeError, ValueError):
            _log.warning("an estimate is left out: %s", estimate)
    return known


def checked_verdicts(
    verdicts: Sequence[Verdict], hypotheses: int, world: WorldModel
) -> list[Verdict]:
    """The verdicts in plain numbers. Raises `ValueError` unless each hypothesis has a sound one."""
    if len(verdicts) != hypotheses:
        raise ValueError(f"{len(verdicts)} verdicts on {hypotheses} hypotheses")
    checked = []
    for verdict in verdicts:
        if not 0.0 <= verdict.likelihood < np.inf:
            raise ValueError(f"no sound verdict: {verdict}")
        place = None if verdict.place is None else _checked_place(verdict.place, world)
        covariance = None if verdict.covariance is None else np.array(verdict.covariance, float)
        if covariance is not None and not _is_covariance(covariance):
            raise ValueError(f"no sound verdict: {verdict}")
        checked.append(
            Verdict(float(verdict.likelihood), place, covariance, _id(verdict.reference))
        )
    return checked


def _checked_place(place: Place, world: WorldModel) -> Place:
    node = operator.index(place.node)
    if node not in world.graph:
        raise ValueError(f"node {node}: there is none")
    return Place(node, _numbers(place.T_node_laser, "place"))


def _id(reference: Any) -> int | None:
    return None if reference is None else operator.index(reference)


def _numbers(pose: Any, name: str) -> np.ndarray:
    values = np.array(pose, float)
    if values.shape != (3,) or not np.all(np.abs(values) <= _FARTHEST):
        raise ValueError(f"{name}: {pose} is not three numbers up to {_FARTHEST:g}")
    return values


def _is_covariance(matrix: np.ndarray) -> bool:
    """Whether it is `(3, 3)`, bounded, symmetric, and has no negative variance in any direction."""
    if matrix.shape != (3, 3) or not np.all(np.abs(matrix) <= _FARTHEST):
        return False
    slack = 1e-6 * max(1e-6, float(np.trace(matrix)))
    if not np.all(np.abs(matrix - matrix.T) <= slack):
        return False
    # With the slack added all pivots of elimination are positive. The library's eigenvalues take
    # several times as long, and a tracker asks some ten times a step.
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = (matrix + slack * np.eye(3)).tolist()
    if xx <= 0.0:
        return False
    yy, yt, tt = yy - xy * xy / xx, yt - xy * xt / xx, tt - xt * xt / xx
    return yy > 0.0 and tt - yt * yt / yy > 0.0
