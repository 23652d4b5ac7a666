"""Match the real logs' splits and print what came of it, beside the paper's choices of candidates.

`python experiments/real_logs.py --out DIR [--quick] [SPLIT ...]`

For each split (reference and query logs with true poses), all queries are matched globally with
all references, with the 5 and with the 1 of the highest preselection value (paper 2.E). Poses in
the logs serve only to score. The data are looked for in the folder `APRJAX_DATA`, else in
`../shared/data` beside the repository.
"""

import argparse
import csv
import dataclasses
import json
import os
import sys
import time
from pathlib import Path

import jax
import numpy as np

import aprjax
from aprjax.configuration import to_dict
from aprjax.io.atomic import atomic_write
from aprjax.metrics import Scores, score_matches

CHOICES: dict[str, int | None] = {"top 1": 1, "top 5": 5, "all": None}


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("splits", nargs="*", help="names of splits (default: all)")
    parser.add_argument("--out", type=Path, required=True, help="folder for the table")
    parser.add_argument("--quick", action="store_true", help="every eighth query only")
    arguments = parser.parse_args()

    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("APRJAX_DATA", default)) / "splits"
    if not folder.is_dir():
        print(f"real_logs: no splits in {folder}; set APRJAX_DATA", file=sys.stderr)
        return 1
    names = arguments.splits or sorted(path.name for path in folder.iterdir())
    rows = []
    print(f"{'split':26s} {'references':10s}  top1  oracle  hits   err/m  err/°  ms/query")
    for name in names:
        for row in split_rows(folder / name, 8 if arguments.quick else 1):
            rows.append({"split": name, **row})
            print(
                "{split:26s} {references:10s}  {top1:.3f} {oracle:.3f}  {hits:.3f}  "
                "{error_m:.3f}  {error_deg:.2f}   {ms:.2f}".format(**rows[-1]),
                flush=True,
            )
    arguments.out.mkdir(parents=True, exist_ok=True)
    with atomic_write(arguments.out / "real_logs.csv", "w") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    config = {"features": to_dict(aprjax.FeatureConfig()), "match": to_dict(aprjax.MatchConfig())}
    with atomic_write(arguments.out / "configuration.json", "w") as file:
        json.dump(config, file, indent=1)
    return 0


def split_rows(folder: Path, stride: int) -> list[dict[str, object]]:
    """One row of the table for each choice of candidates."""
    references = list(aprjax.read_log(folder / "references.log.gz"))
    queries = list(aprjax.read_log(folder / "queries.log.gz"))[::stride]
    mapped = np.loadtxt(folder / "mapped.txt", dtype=bool, ndmin=1)[::stride]
    T_world_ref = np.array([entry.logged_pose for entry in references])
    T_world_query = np.array([entry.logged_pose for entry in queries])
    built = aprjax.ReferenceSet.build([entry.scan for entry in references])
    scans = aprjax.Scan.stack([entry.scan for entry in queries])
    rows = []
    for label, top_k in CHOICES.items():
        config = dataclasses.replace(aprjax.MatchConfig(), top_k=top_k)
        jax.block_until_ready(aprjax.match_batch(scans, built, config))
        began = time.perf_counter()
        result = jax.block_until_ready(aprjax.match_batch(scans, built, config))
        seconds = time.perf_counter() - began
        scores: Scores = score_matches(result, built.ids, T_world_ref, T_world_query, mapped)
        figures = {name: round(value, 4) for name, value in dataclasses.asdict(scores).items()}
        rows.append({"references": label, **figures, "ms": round(1e3 * seconds / len(queries), 3)})
    return rows


if __name__ == "__main__":
    sys.exit(main())
