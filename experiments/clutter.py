"""How cluttered the simulated lab is, beside real logs.

    python experiments/clutter.py --out DIR [--quick]

One row for each real log and each of the lab's seeds 0 to 4: anchors per scan, how many of them
reappear within 0.1 m in another scan of the same place (within 1 m and 30°), and the share of the
beams that the segmentation removes as small. Reads corrected logs (see `data.py` for where).
Writes `clutter.csv` into DIR; the exit status is 1 if a lab lies outside the logs' range.
"""

import argparse
import sys
from pathlib import Path

from anchors import WITHIN, Described, describe, read, repeatability_rows, scan_row
from data import corrected_log
from outputs import print_table, write_table

from aprjax.sim.lab import lab

LOGS = ("intel", "fhw", "aces", "belgioioso", "csail", "freiburg-079")
SEEDS = range(5)
COMPARED = ("anchors", "repeatability", "small_share")
PLACE = WITHIN.index((1.0, 30.0))  # the class of pairs that every log has enough of


def row(name: str, described: Described, pairs: int) -> dict:
    """What is compared, for one log or lab."""
    scans = scan_row(name, described)
    repeated = repeatability_rows(name, described, pairs, radius=0.1)[PLACE]
    return {
        "place": name,
        "scans": scans["scans"],
        "anchors": scans["anchors"],
        "pairs": repeated["pairs"],
        "repeatability": repeated["all"],
        "small_share": scans["small_share"],
    }


def main() -> int:
    """Print and write the table; the exit status."""
    parser = argparse.ArgumentParser(description="Clutter of the simulated lab and of real logs.")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="fewer pairs")
    arguments = parser.parse_args()
    pairs = 100 if arguments.quick else 300

    paths = {name: corrected_log(name) for name in LOGS}
    arguments.out.mkdir(parents=True, exist_ok=True)

    logs = [
        # Freiburg's log has a scan every 9 cm; a fifth of them leaves pairs enough.
        row(name, read(path, 5 if name == "freiburg-079" else 1), pairs)
        for name, path in paths.items()
    ]
    labs = []
    for seed in SEEDS:
        run = lab(seed).queries
        labs.append(row(f"lab {seed}", describe(run.scans, run.T_world_laser), pairs))
    write_table(logs + labs, arguments.out / "clutter.csv")
    print_table(logs + labs)

    outside = 0
    for column in COMPARED:
        low, high = (limit(entry[column] for entry in logs) for limit in (min, max))
        out = [entry["place"] for entry in labs if not low <= entry[column] <= high]
        outside += len(out)
        print(f"{column}: logs span {low} to {high}; outside: {', '.join(out) or 'none'}")
    return 1 if outside else 0


if __name__ == "__main__":
    sys.exit(main())
