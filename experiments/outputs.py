"""What the experiments write: tables, figures, and the configuration that made them."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import aprjax
from aprjax.atomic import atomic_write
from aprjax.configuration import to_dict

BLUE, LIGHT, DARK, RED = "#1f5fa8", "#9db8d6", "#333333", "#c1272d"


def write_table(rows: list[dict], path: Path) -> None:
    """The rows as a CSV file."""
    with atomic_write(path) as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def print_table(rows: list[dict]) -> None:
    """The rows, aligned, on standard output."""
    cells = [list(rows[0]), *([str(value) for value in row.values()] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for line in cells:
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))
    print(flush=True)


def write_figure(figure: Figure, path: Path, dpi: int = 110) -> None:
    """The figure as a PNG file."""
    with atomic_write(path, "wb") as file:
        figure.savefig(file, format="png", dpi=dpi)


def grouped_bars(
    ax: Axes, names: Sequence[str], series: Mapping[str, Sequence[float]], start: float = 0.0
) -> None:
    """For each name, from above, a bar of either series; with their values where they start at 0.

    Bars reach from `start` to the values.
    """
    for (label, values), offset, colour in zip(
        series.items(), (-0.2, 0.2), (BLUE, LIGHT), strict=True
    ):
        places, lengths = np.arange(len(names)) + offset, np.subtract(values, start)
        bars = ax.barh(places, lengths, left=start, height=0.4, color=colour, label=label)
        if start == 0.0:
            ax.bar_label(bars, fmt="%.3f", padding=3, fontsize=8)
    ax.set_yticks(range(len(names)), names)
    # Axes that share their names are turned once, not back again.
    if not ax.yaxis_inverted():
        ax.invert_yaxis()


def write_configuration(folder: Path, **more: Any) -> None:
    """`configuration.json`: `more`, and the defaults of the package."""
    config = {
        **more,
        "features": to_dict(aprjax.FeatureConfig()),
        "match": to_dict(aprjax.MatchConfig()),
    }
    with atomic_write(folder / "configuration.json") as file:
        json.dump(config, file, indent=1)
