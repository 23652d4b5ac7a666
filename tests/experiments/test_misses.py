import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.matcher import MatchConfig
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.shortlist import ShortlistConfig
from experiments.misses import Loss, Poses, Stages, losses, lost
from tests.worlds import office, scan_at

PLACES = np.array([[12.0, 0.0, 0.3], [6.0, 0.2, 0.0], [18.0, 0.0, 2.0]])
QUERIES = np.array([[12.4, 0.1, 0.2], [6.5, 0.1, 0.1]])
SMALL = MatchConfig(shortlist=ShortlistConfig(passed=8, kept=4))

TRUE = np.array([[1.0, 0.0, 0.0], [3.0, 1.0, 0.5]])  # T_ref_query of two references
WRONG = np.array([7.0, 7.0, 1.0])


@pytest.fixture(scope="module")
def scene():
    world = office(seed=3)
    references = ReferenceSet.build([scan_at(world, pose) for pose in PLACES])
    return Scan.stack([scan_at(world, pose) for pose in QUERIES]), references


def changed(where, value) -> MatchConfig:
    return eqx.tree_at(where, SMALL, np.float32(value))


@pytest.mark.parametrize(
    ("config", "loss"),
    [
        (SMALL, Loss.RANKED_BELOW),
        (changed(lambda c: c.voting.length, -1), Loss.NOT_VOTED),
        (changed(lambda c: c.alignment.min_anchors, 99), Loss.SECOND_LOOK),
    ],
    ids=["nothing wrong", "no edges correspond", "no anchors are enough"],
)
def test_the_stage_that_was_made_to_fail_is_named(scene, config, loss):
    queries, references = scene
    assert losses(queries, references, PLACES, QUERIES, config).tolist() == [loss, loss]


def test_without_the_cascade_its_stages_are_refused(scene):
    queries, references = scene
    with pytest.raises(ValueError, match="cascade"):
        losses(queries, references, PLACES, QUERIES, MatchConfig(cascade=False))


def test_no_anchor_is_common_with_a_place_that_the_query_was_not_taken_at(scene):
    queries, references = scene
    elsewhere = QUERIES + np.array([0.2, -1.0, 0.6])
    found = losses(queries, references, PLACES, elsewhere, SMALL)
    assert found.tolist() == [Loss.NO_COMMON_ANCHORS] * 2


def poses_of(poses, rows, valid=True) -> Poses:
    return Poses(jnp.asarray(poses), jnp.asarray(rows), jnp.full(len(poses), valid))


RIGHT_ONE = poses_of([WRONG, TRUE[1]], [0, 1])
NONE_RIGHT = poses_of([WRONG, TRUE[0]], [0, 1])  # right for the other reference only


@pytest.mark.parametrize(
    ("stages", "loss"),
    list(enumerate([Loss.NOT_VOTED, Loss.FIRST_LOOK, Loss.SECOND_LOOK, Loss.DIVERGED])),
)
def test_it_is_lost_after_the_last_stage_that_has_a_right_alternative(stages, loss):
    """And by its rank where all of them have one."""
    left = [RIGHT_ONE] * stages + [NONE_RIGHT] * (4 - stages)
    found = Stages(jnp.array([5, 0]), *left)
    assert lost(jax.device_get(found), TRUE) == loss
    found = Stages(found.common, *left[:3], RIGHT_ONE)
    assert lost(jax.device_get(found), TRUE) == Loss.RANKED_BELOW


def test_alternatives_that_are_not_valid_are_none():
    invalid = poses_of(TRUE, [0, 1], valid=False)
    found = Stages(jnp.array([1, 9]), *[invalid] * 4)
    # Reference 1 shows nine of the anchors, but lies more than 2 m away.
    assert lost(jax.device_get(found), TRUE) == Loss.NO_COMMON_ANCHORS


def test_a_place_that_shows_common_anchors_could_have_been_voted_for():
    near = TRUE * [[1, 1, 1], [0.5, 1, 1]]
    none = poses_of(near, [0, 1], valid=False)
    for common, loss in (([1, 2], Loss.NOT_VOTED), ([1, 1], Loss.NO_COMMON_ANCHORS)):
        found = Stages(jnp.array(common), *[none] * 4)
        assert lost(jax.device_get(found), near) == loss
