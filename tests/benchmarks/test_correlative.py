import numpy as np
import pytest

from benchmarks import correlative
from benchmarks.correlative import Raster, match
from tests.worlds import office, scan_at


def points_from(pose) -> np.ndarray:
    scan = scan_at(office(seed=3), np.array(pose, float))
    return np.asarray(scan.points, float)[np.asarray(scan.hit)]


@pytest.mark.parametrize("query", [(12.3, 0.1, 0.5), (11.5, -0.1, 0.1), (12.0, 0.0, 0.3)])
def test_the_pose_between_two_scans_is_found(query):
    reference = (12.0, 0.0, 0.3)
    pose, score = match(Raster.of(points_from(reference)), points_from(query))
    cos, sin = np.cos(reference[2]), np.sin(reference[2])
    x, y = query[0] - reference[0], query[1] - reference[1]
    wanted = [cos * x + sin * y, cos * y - sin * x, query[2] - reference[2]]
    np.testing.assert_allclose(pose, wanted, atol=0.1)
    assert 0 < score <= 1


def test_coarse_to_fine_finds_what_an_exhaustive_search_finds(monkeypatch):
    monkeypatch.setattr(correlative, "REACH", 0.8)
    monkeypatch.setattr(correlative, "TURN", np.radians(20))
    rng = np.random.default_rng(0)
    for _ in range(5):
        reference, query = rng.uniform(-3, 3, (2, 40, 2))
        raster = Raster.of(reference)
        fine, best = raster.levels[0], 0.0
        for theta in np.arange(0, 2 * np.pi, correlative.TURN):
            turn = np.array([[np.cos(theta), np.sin(theta)], [-np.sin(theta), np.cos(theta)]])
            placed = (query @ turn - raster.origin - correlative.REACH) / correlative.CELL
            for i in range(32):
                for j in range(32):
                    x, y = (np.floor(placed).astype(int) + np.array([i, j])).T
                    inside = (x >= 0) & (y >= 0) & (x < fine.shape[0]) & (y < fine.shape[1])
                    best = max(best, float(fine[x[inside], y[inside]].sum()))
        assert match(raster, query)[1] * len(query) >= best - 1e-4


def test_each_level_bounds_the_one_below():
    raster = Raster.of(np.random.default_rng(1).uniform(-3, 3, (30, 2)))
    for level in range(1, correlative.LEVELS):
        width, fine = correlative.FACTOR**level, raster.levels[0]
        x, y = np.indices(fine.shape)
        assert np.all(raster.levels[level][x // width, y // width] >= fine)
