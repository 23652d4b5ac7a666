"""How cluttered the simulated lab is, beside real logs.

    python -m experiments.clutter --out DIR [--quick]

One row for each real log and each of the lab's seeds 0 to 4: anchors per scan, how many of them
reappear within 0.1 m in another scan of the same place (within 1 m and 30°), and the share of the
beams that the segmentation removes as small. Reads corrected logs (see `data.py` for where).
Prints which labs lie outside the logs' range. Writes `clutter.csv`, `clutter.png` and
`configuration.json` into DIR.
"""

import argparse
import sys
from pathlib import Path

from matplotlib.figure import Figure

from aprjax.sim.lab import lab
from experiments.anchors import (
    RADIUS,
    WITHIN,
    Described,
    describe,
    read,
    repeatability_rows,
    scan_row,
)
from experiments.data import corrected_log
from experiments.outputs import (
    BLUE,
    DARK,
    LIGHT,
    print_table,
    write_configuration,
    write_figure,
    write_table,
)

LOGS = ("intel", "fhw", "aces", "belgioioso", "csail", "freiburg-079")
SEEDS = range(5)
COMPARED = {
    "anchors": "anchors per scan",
    "repeatability": "share of anchors that reappear",
    "small_share": "share of beams on small parts",
}
PLACE = WITHIN.index((1.0, 30.0))  # the class of pairs that every log has enough of


def row(name: str, described: Described, pairs: int) -> dict:
    """What is compared, for one log or lab."""
    scans = scan_row(name, described)
    repeated = repeatability_rows(name, described, pairs, RADIUS)[PLACE]
    return {
        "place": name,
        "scans": scans["scans"],
        "anchors": scans["anchors"],
        "pairs": repeated["pairs"],
        "repeatability": repeated["all"],
        "small_share": scans["small_share"],
    }


def draw(logs: list[dict], labs: list[dict]) -> Figure:
    """What is compared, with the range of the logs."""
    rows = logs + labs
    figure = Figure(figsize=(11, 0.28 * len(rows) + 1.2), layout="constrained")
    panels = figure.subplots(1, len(COMPARED), sharey=True)
    for ax, (column, label) in zip(panels, COMPARED.items(), strict=True):
        for place, entry in enumerate(rows):
            fill, ink = (LIGHT, "black") if entry in logs else (BLUE, "white")
            ax.barh(place, entry[column], color=fill, height=0.7)
            ax.text(0, place, f" {entry[column]}", va="center", fontsize=8, color=ink)
        for limit in (min, max):
            ax.axvline(limit(entry[column] for entry in logs), color=DARK, lw=0.8, ls="--")
        ax.set_xlabel(label)
    panels[0].set_yticks(range(len(rows)), [entry["place"] for entry in rows])
    panels[0].invert_yaxis()
    figure.legend(
        panels[0].lines[:1], ["range of the logs"], loc="outside lower center", frameon=False
    )
    return figure


def main() -> int:
    """Measure, print, draw; the exit status."""
    parser = argparse.ArgumentParser(description="Clutter of the simulated lab and of real logs.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="fewer pairs")
    arguments = parser.parse_args()
    pairs = 100 if arguments.quick else 300

    paths = {name: corrected_log(name) for name in LOGS}
    # Freiburg's log has a scan every 9 cm; a fifth of them leaves pairs enough.
    every = {name: 5 if name == "freiburg-079" else 1 for name in LOGS}
    arguments.out.mkdir(parents=True, exist_ok=True)

    logs = [row(name, read(path, every[name]), pairs) for name, path in paths.items()]
    labs = []
    for seed in SEEDS:
        run = lab(seed).queries
        labs.append(row(f"lab {seed}", describe(run.scans, run.T_world_laser), pairs))
    write_table(logs + labs, arguments.out / "clutter.csv")
    print_table(logs + labs)
    write_figure(draw(logs, labs), arguments.out / "clutter.png")
    write_configuration(
        arguments.out, logs=LOGS, every=every, seeds=list(SEEDS), pairs=pairs,
        within=WITHIN[PLACE], radius=RADIUS,
    )  # fmt: skip

    for column in COMPARED:
        low, high = (limit(entry[column] for entry in logs) for limit in (min, max))
        out = [entry["place"] for entry in labs if not low <= entry[column] <= high]
        print(f"{column}: logs span {low} to {high}; outside: {', '.join(out) or 'none'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
