"""Write two small CARMEN logs of a simulated office: `python tests/make_logs.py DIR`.

`references.log.gz` and `queries.log.gz` hold ROBOTLASER1 lines whose laser pose is the truth. Each
query was taken within 1 m and 20° of a reference, with no wall between. The files are the same
bytes every time.
"""

import gzip
import sys
from pathlib import Path

import numpy as np

# As a script, only its own folder is on the path.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from aprjax.atomic import atomic_write
from aprjax.scan import Scan
from tests.worlds import cast, clearance, free_pose, office, scan_at

# As many as the matcher's own tests have, up to a bucket: all share one compilation.
REFERENCES, QUERIES = 8, 20
NOISE = 0.01


def write_logs(folder: str | Path) -> tuple[Path, Path]:
    """The logs' paths, references first, written into `folder`, which is made if need be."""
    rng = np.random.default_rng(7)
    world = office(seed=3)
    references: list[np.ndarray] = []
    while len(references) < REFERENCES:
        pose = free_pose(world, rng)
        if all(np.hypot(*(pose - other)[:2]) > 1.5 for other in references):
            references.append(pose)
    queries = [_near(world, references[i % REFERENCES], rng) for i in range(QUERIES)]
    paths = Path(folder) / "references.log.gz", Path(folder) / "queries.log.gz"
    paths[0].parent.mkdir(parents=True, exist_ok=True)
    for path, poses in zip(paths, (references, queries), strict=True):
        lines = [
            laser_line(scan_at(world, pose, noise=NOISE, rng=rng), pose, stamp=0.5 * i)
            for i, pose in enumerate(poses)
        ]
        with atomic_write(path, "wb") as file:
            file.write(gzip.compress("".join(lines).encode(), mtime=0))
    return paths


def laser_line(scan: Scan, pose: np.ndarray, stamp: float) -> str:
    """`scan` as a ROBOTLASER1 line; beams without return read as the header's maximum."""
    ranges = np.where(np.isposinf(scan.ranges), scan.range_max, scan.ranges)
    fov = scan.angle_increment * (ranges.size - 1)
    x, y, theta = pose
    return (
        f"ROBOTLASER1 0 {scan.angle_min:.6f} {fov:.6f} {scan.angle_increment:.8f} "
        f"{scan.range_max:.2f} {NOISE} 0 {ranges.size} {' '.join(f'{r:.3f}' for r in ranges)} 0 "
        f"{f'{x:.6f} {y:.6f} {theta:.6f} ' * 2}0 0 0 0 0 {stamp:.2f} simulated {stamp:.2f}\n"
    )


def _near(world: np.ndarray, reference: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    while True:
        distance, direction = rng.uniform(0, 1), rng.uniform(-np.pi, np.pi)
        turn = rng.uniform(-np.pi / 9, np.pi / 9)
        angle = reference[2] + direction
        pose = reference + np.array([distance * np.cos(angle), distance * np.sin(angle), turn])
        seen = cast(world, reference, np.array([direction]))[0] > distance
        if seen and clearance(world, pose[:2]) >= 0.3:
            return pose


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tests/make_logs.py DIR")
    for written in write_logs(sys.argv[1]):
        print(written, file=sys.stderr)
