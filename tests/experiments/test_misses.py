import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.alignment.align import Alternatives
from aprjax.matcher import MatchConfig
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from aprjax.shortlist import Shortlist, ShortlistConfig
from experiments.misses import Loss, Stages, losses, lost
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


@pytest.mark.parametrize(
    ("change", "loss"),
    [
        (lambda config: config, Loss.RANKED_BELOW),
        (
            lambda config: eqx.tree_at(lambda c: c.alignment.min_anchors, config, np.float32(99)),
            Loss.NOT_ALIGNED,
        ),
        (
            lambda config: eqx.tree_at(
                lambda c: c.alignment.correspondence.angle, config, np.float32(0)
            ),
            Loss.WRONG_ROTATION,
        ),
    ],
    ids=["nothing wrong", "no alternative is enough", "no rotation is close enough"],
)
def test_the_stage_that_was_made_to_fail_is_named(scene, change, loss):
    queries, references = scene
    assert losses(queries, references, PLACES, QUERIES, change(SMALL)).tolist() == [loss, loss]


def test_no_anchor_is_common_with_a_place_that_the_query_was_not_taken_at(scene):
    queries, references = scene
    elsewhere = QUERIES + np.array([0.8, 0.6, 0.5])
    found = losses(queries, references, PLACES, elsewhere, SMALL)
    assert found.tolist() == [Loss.NO_COMMON_ANCHORS] * 2


def shortlist_of(poses, rows, valid=True) -> Shortlist:
    count = len(poses)
    ones = jnp.ones(count, jnp.int32)
    alternatives = Alternatives(jnp.asarray(poses), ones, ones, jnp.full(count, valid))
    return Shortlist(alternatives, jnp.asarray(rows))


RIGHT_ONE = shortlist_of([WRONG, TRUE[1]], [0, 1])
NONE_RIGHT = shortlist_of([WRONG, TRUE[0]], [0, 1])  # right for the other reference only


@pytest.mark.parametrize(
    ("stages", "loss"),
    list(enumerate([Loss.NOT_ALIGNED, Loss.FIRST_LOOK, Loss.SECOND_LOOK, Loss.DIVERGED])),
)
def test_it_is_lost_after_the_last_stage_that_has_a_right_alternative(stages, loss):
    """And by its rank where all of them have one."""
    left = [RIGHT_ONE] * stages + [NONE_RIGHT] * (4 - stages)
    found = Stages(jnp.array([5, 0]), jnp.array([True, False]), *left)
    assert lost(jax.device_get(found), TRUE) == loss
    found = Stages(found.common, found.rotated, *left[:3], RIGHT_ONE)
    assert lost(jax.device_get(found), TRUE) == Loss.RANKED_BELOW


def test_alternatives_that_are_not_valid_are_none():
    invalid = shortlist_of(TRUE, [0, 1], valid=False)
    found = Stages(jnp.array([1, 9]), jnp.array([True, True]), *[invalid] * 4)
    # Reference 1 shows nine of the anchors, but lies more than 2 m away.
    assert lost(jax.device_get(found), TRUE) == Loss.NO_COMMON_ANCHORS


def test_only_references_with_common_anchors_can_have_the_right_rotation():
    near = TRUE * [[1, 1, 1], [0.5, 1, 1]]
    none = shortlist_of(near, [0, 1], valid=False)
    found = Stages(jnp.array([4, 0]), jnp.array([False, True]), *[none] * 4)
    assert lost(jax.device_get(found), near) == Loss.WRONG_ROTATION
