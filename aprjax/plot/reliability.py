"""Reliability diagrams: how often hypotheses are right, over the probability they claim."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aprjax.metrics import reliability

_DOTS, _LINE = "#d9480f", "#999999"


def draw_reliability(
    probability: np.ndarray, right: np.ndarray, title: str = "", *, ax: Axes | None = None
) -> list[Artist]:
    """Draw the share of right hypotheses in ten bins of probability; both arrays are `(n,)`.

    The area of a dot grows with the number of hypotheses in its bin, which stands beside it.
    """
    bins = reliability(probability, right)
    if ax is None:
        ax = Figure(figsize=(4, 4), layout="constrained").add_subplot()
    drawn: list[Artist] = [*ax.plot([0, 1], [0, 1], color=_LINE, linewidth=0.8, zorder=1)]
    area = 15 + 285 * bins.count / max(bins.count.max(initial=1), 1)
    drawn.append(ax.scatter(bins.claimed, bins.right, s=area, color=_DOTS, alpha=0.7, zorder=2))
    style = {"textcoords": "offset points", "ha": "center", "va": "top", "fontsize": 7}
    drawn += [
        ax.annotate(str(count), (x, y), xytext=(0, -radius - 2), **style)
        for x, y, count, radius in zip(
            bins.claimed, bins.right, bins.count, np.sqrt(area / np.pi), strict=True
        )
    ]
    ax.set(xlim=(-0.12, 1.12), ylim=(-0.12, 1.12), xlabel="probability", ylabel="share right")
    ax.set_title(f"{title}  error {bins.error:.3f}".strip(), fontsize=9)
    return drawn
