"""How well classes of views tell places apart, against true poses."""

from dataclasses import dataclass

import numpy as np

from aprjax.places.neural_gas import NeuralGas
from aprjax.plane import distance, wrap

MAPPED, TURNED = 2.0, np.radians(40.0)
"""A view is mapped where a registered one was taken within these, in metres and radians."""
PLACE = 1.0
"""Metres within which views, not turned by more than `TURNED`, are of one place."""
FAR = 5.0
"""Metres beyond which two views are of different places."""


@dataclass(frozen=True)
class Recognition:
    """Shares of views that fall into a class registered at a place, or a neighbouring one."""

    mapped: int
    """Views that are scored."""
    here: float
    """At the place where the view was taken."""
    far: float
    """At places over 5 m away, over all pairs of a mapped view and such a place."""
    here_nearest: float
    """As `here` with the place's one nearest view instead of all of its views."""
    far_nearest: float


def recognition(
    gas: NeuralGas,
    registered: tuple[np.ndarray, np.ndarray],
    seen: tuple[np.ndarray, np.ndarray],
) -> Recognition:
    """Score classes `(views,)` of a second run against those registered in a first one.

    Both come with their true poses `(views, 3)` in metres and radians. Each registered view is a
    place: the classes registered there are those of all registered views within 1 m and 40° of
    it. A view's own place is the nearest registered view within 2 m and 40°, 1 m weighing as
    much as 30°. NaN where there is nothing to take a share of.
    """
    (poses, classes), (queries, asked) = registered, seen
    gap, turn = _apart(queries, poses)
    weighed = np.where((gap < MAPPED) & (turn < TURNED), gap + turn / np.radians(30.0), np.inf)
    own, mapped = weighed.argmin(axis=1), np.isfinite(weighed.min(axis=1))
    between, turned = _apart(poses, poses)
    member = (between < PLACE) & (turned < TURNED)
    alike = gas.alike(asked[mapped][:, None], classes[None])
    at_place = (alike.astype(float) @ member.T) > 0
    own, far = own[mapped], gap[mapped] > FAR
    row = np.arange(len(own))
    with np.errstate(invalid="ignore"):
        return Recognition(
            mapped=len(own),
            here=float(at_place[row, own].sum() / np.float64(len(own))),
            far=float(at_place[far].sum() / np.float64(far.sum())),
            here_nearest=float(alike[row, own].sum() / np.float64(len(own))),
            far_nearest=float(alike[far].sum() / np.float64(far.sum())),
        )


def _apart(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Metres and radians between all pairs of poses."""
    gap = one[:, None] - other[None]
    return distance(gap), np.abs(wrap(gap[..., 2]))
