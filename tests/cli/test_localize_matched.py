"""`aprjax localize` with the real matcher, on a map of a few simulated places."""

import csv

import numpy as np
import pytest

from aprjax.cli.main import main
from aprjax.plane import compose, relative
from aprjax.world.model import WorldModel
from aprjax.world.parts import Appearance, Arc, Place
from aprjax.world.store import save_map
from tests.make_logs import laser_line
from tests.worlds import office, scan_at

# Along the corridor, three metres apart.
NODES = np.array([[4.0 + 3.0 * k, 0.0, 0.0] for k in range(4)])
ODOMETRY_START = np.array([-3.0, 8.0, 2.0])


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    folder = tmp_path_factory.mktemp("matched")
    plan, rng = office(seed=3), np.random.default_rng(4)
    world = WorldModel()
    for k in range(len(NODES)):
        world.add_node(10 * k)
        if k:
            T = relative(NODES[k - 1], NODES[k])
            world.add_arc(Arc(k - 1, k, T, 1e-4 * np.eye(3), "driven"))
    world.add_references(
        [scan_at(plan, pose, noise=0.01, rng=rng) for pose in NODES],
        [Appearance(Place(k, np.zeros(3)), 10 * k) for k in range(len(NODES))],
    )
    save_map(world, folder / "office.map")
    lines = [
        laser_line(
            scan_at(plan, pose, noise=0.01, rng=rng),
            compose(ODOMETRY_START, relative(path()[0], pose)),
            0.5 * k,
        )
        for k, pose in enumerate(path())
    ]
    (folder / "track.log").write_text("".join(lines))
    table = folder / "t.csv"
    arguments = [folder / "office.map", folder / "track.log", "--out", table, "--scan-classes"]
    assert main(["localize", *map(str, arguments)]) == 0
    with table.open(newline="") as file:
        return list(csv.DictReader(file))


def path():
    """Poses of a robot that drives down the corridor, a little aside of its middle."""
    return np.array([[4.3 + 0.8 * k, 0.1, 0.03 * (-1) ** k] for k in range(10)])


def test_a_robot_is_found_and_kept_past_several_nodes(rows):
    best = [row for row in rows if row["rank"] == "0" and row["reference"]]
    assert best[-1]["scan"] == "9"
    for row in best[-6:]:
        reference = NODES[int(row["reference"]) // 10]
        found = compose(reference, np.array([float(row[c]) for c in ("x", "y", "theta")]))
        np.testing.assert_allclose(found, path()[int(row["scan"])], atol=0.15)
        assert row["situation"] == "tracking"
    assert len({row["node"] for row in best}) > 1
