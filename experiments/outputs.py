"""What the experiments write: tables, figures, and the configuration that made them."""

import csv
import json
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

import aprjax
from aprjax.atomic import atomic_write
from aprjax.configuration import to_dict


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


def write_configuration(folder: Path, **more: Any) -> None:
    """`configuration.json`: `more`, and the defaults of the package."""
    config = {
        **more,
        "features": to_dict(aprjax.FeatureConfig()),
        "match": to_dict(aprjax.MatchConfig()),
    }
    with atomic_write(folder / "configuration.json") as file:
        json.dump(config, file, indent=1)
