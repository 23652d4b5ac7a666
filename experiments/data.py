"""Where the public logs lie, and how their splits are read.

The folder of the data is what the environment variable APRJAX_DATA names, else `../shared/data`
beside the repository. The logs are CARMEN's, from Radish, the Robotics Data Set Repository: Intel
Research Lab, Freiburg's building 079, the FHW museum, ACES in Austin, Belgioioso castle, MIT CSAIL.
Poses in them are the truth, which only scores. In it lie

    logs/NAME-corrected.log.gz      whole runs as published; NAME.graph.log.gz, as pose graphs
    splits/NAME/references.log.gz   the scans of a run that are kept, and of the same or a later one
    splits/NAME/queries.log.gz      those that are matched; interleaved: the scans in between;
                                    revisit: later passes, also where no reference was taken
    splits/NAME/mapped.txt          a 1 for each query with a reference within 2 m and 40° that no
                                    wall parts from it, else a 0
    maps/NAME/build.log.gz, .tum    scans with raw odometry, and the truth apart
    tracks/NAME/build.*, track.*    the same of two drives; kidnapped_at.txt, numbers of scans
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import aprjax

FOUR = ("freiburg-079.revisit", "fhw.revisit", "aces.interleaved", "belgioioso.interleaved")
"""Splits of four buildings, for experiments that are too long for all."""


@dataclass(frozen=True)
class Split:
    """A log divided into references and queries. Poses are in metres and radians, of the laser."""

    name: str
    references: aprjax.Scan
    """Stacked."""
    queries: aprjax.Scan
    T_world_ref: np.ndarray
    """`(references, 3)`, the truth, as that of the queries: to score with, and nothing else."""
    T_world_query: np.ndarray
    mapped: np.ndarray
    """`(queries,)`: a reference was taken within 2 m and 40°, with no wall between."""


def data_root() -> Path:
    """The folder of the data, whether it is there or not."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("APRJAX_DATA") or beside)


def corrected_log(name: str) -> Path:
    """A corrected log, in which the poses of the FLASER lines are the truth."""
    return _found(data_root() / "logs" / f"{name}-corrected.log.gz")


def split_names() -> list[str]:
    """All splits there are."""
    return sorted(path.name for path in _found(data_root() / "splits").iterdir())


def read_split(name: str, stride: int = 1) -> Split:
    """A split with every `stride`-th of its queries."""
    folder = _found(data_root() / "splits" / name)
    references = list(aprjax.read_log(folder / "references.log.gz"))
    queries = list(aprjax.read_log(folder / "queries.log.gz"))[::stride]
    return Split(
        name=name,
        references=aprjax.Scan.stack([entry.scan for entry in references]),
        queries=aprjax.Scan.stack([entry.scan for entry in queries]),
        T_world_ref=np.array([entry.logged_pose for entry in references], float),
        T_world_query=np.array([entry.logged_pose for entry in queries], float),
        mapped=np.loadtxt(folder / "mapped.txt", dtype=bool, ndmin=1)[::stride],
    )


def map_names() -> list[str]:
    """All logs that maps are built from."""
    return sorted(path.name for path in _found(data_root() / "maps").iterdir())


def map_folder(name: str) -> Path:
    """A whole run with raw odometry, `build.log.gz`, and the truth, `build.tum`."""
    return _found(data_root() / "maps" / name)


def track_folder(name: str) -> Path:
    """A run to build a map from and one to localize in it, `build` and `track`, with the truth."""
    return _found(data_root() / "tracks" / name)


def _found(path: Path) -> Path:
    """The path, if it is there; a script without its data ends in one clear line."""
    if not path.exists():
        raise SystemExit(f"{path} is not there: set APRJAX_DATA to the folder of the logs")
    return path
