"""One step of the robot from what several tracking sources measured of it."""

from collections.abc import Sequence

import numpy as np

from aprjax.plane import wrap
from aprjax.tracking.hypothesis import Step


def fuse(steps: Sequence[Step], unmeasured: float) -> Step:
    """The weighted mean of the steps, each number weighed by the inverse of its covariance.

    Errors of different sources are taken for independent. Numbers that no source measured are zero
    with the deviation `unmeasured`, in metres or radians. Doubts add up as independent ones do.
    """
    doubt = 1.0 - float(np.prod([1.0 - step.doubt for step in steps]))
    measured = [step for step in steps if np.any(np.isfinite(np.diag(step.covariance)))]
    if len(measured) == 1 and np.all(np.isfinite(measured[0].covariance)):
        return Step(measured[0].T_before_now, measured[0].covariance, doubt)
    information, weighed = np.zeros((3, 3)), np.zeros(3)
    # Headings are averaged as differences from the first one, which are small.
    heading = next(
        (float(s.T_before_now[2]) for s in measured if np.isfinite(s.covariance[2, 2])), 0.0
    )
    for step in measured:
        known = np.isfinite(np.diag(step.covariance))
        part = np.ix_(known, known)
        # A step at rest is certain; the tiny variance keeps it invertible.
        own = np.zeros((3, 3))
        own[part] = np.linalg.inv(step.covariance[part] + 1e-12 * np.eye(int(known.sum())))
        T = step.T_before_now.copy()
        T[2] = wrap(np.asarray(T[2] - heading))
        information += own
        weighed += own @ np.where(known, T, 0.0)
    missing = np.diag(information) == 0.0
    information[missing, missing] = unmeasured**-2.0
    covariance = np.linalg.inv(information)
    T = covariance @ weighed
    T[2] = wrap(np.asarray(T[2] + heading))
    return Step(T, 0.5 * (covariance + covariance.T), doubt)
