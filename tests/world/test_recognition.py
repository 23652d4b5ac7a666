"""Which earlier scans may answer, and how much agreement a place needs."""

from typing import NamedTuple

import numpy as np
import pytest

from aprjax.world import follow as following
from aprjax.world import recognition
from aprjax.world.alignment import Aligned
from aprjax.world.closure import Located
from aprjax.world.follow import FollowConfig, follow
from aprjax.world.motion import Motion
from aprjax.world.parts import Place
from aprjax.world.recognition import RecognitionConfig, Sightings, sightings
from aprjax.world.smoothing import Measurements

NONE = np.zeros(0, int)
NO_SIGHTINGS = Sightings(NONE, NONE, np.zeros((0, 3)), np.zeros(0))


def straight(scans: int, step: float) -> Motion:
    poses = np.zeros((scans, 3))
    poses[:, 0] = step * np.arange(scans)
    nothing = Measurements(NONE, NONE, np.zeros((0, 3)), np.zeros((0, 3, 3)))
    return Motion(poses, np.zeros((scans, 3, 3)), poses[:, 0], nothing)


class Answers(NamedTuple):
    valid: np.ndarray
    reference: np.ndarray
    T_ref_query: np.ndarray
    quality: np.ndarray


@pytest.mark.parametrize("batch", [1, 8])
def test_each_scan_is_compared_with_all_that_are_old_enough_for_it(square, monkeypatch, batch):
    def every_one(scans, references, config, *, exclude):
        ids = np.asarray(references.index.ids)
        shape = len(exclude), len(ids)
        may = (ids >= 0) & ~np.any(ids[None, :, None] == exclude[:, None, :], axis=2)
        return Answers(may, np.broadcast_to(ids, shape), np.zeros((*shape, 3)), np.ones(shape))

    monkeypatch.setattr(recognition, "match_batch", every_one)
    found = sightings(square.references, straight(3, step=10.0), RecognitionConfig(batch=batch))
    assert list(zip(found.scan, found.earlier, strict=True)) == [(2, 0)]
    found = sightings(square.references, straight(3, step=16.0), RecognitionConfig(batch=batch))
    assert set(zip(found.scan, found.earlier, strict=True)) == {(1, 0), (2, 0), (2, 1)}


def test_where_much_is_possible_a_place_needs_firm_agreement(square, monkeypatch):
    config = FollowConfig()
    some = float(config.agreement + config.firm) / 2

    def aligned(views, first, second, starts, weights, config):
        count = len(first)
        return Aligned(
            np.tile([1.0, 0, 0], (count, 1)), np.zeros((count, 3, 3)), np.full(count, some)
        )

    monkeypatch.setattr(following, "align_pairs", aligned)
    here = Place(0, np.array([1.0, 0, 0]))

    def found(deviation: float, turn: float):
        expected = Located(here, np.diag([deviation**2, 0, turn**2]))
        places = {0: Place(0, np.zeros(3))}
        moved = straight(2, step=20.0)
        return follow(1, expected, {0: [0]}, places, NO_SIGHTINGS, moved, None, square, config)

    assert found(0.1, 0.01) is not None
    assert found(1.0, 0.01) is None
    assert found(0.1, 0.3) is None
