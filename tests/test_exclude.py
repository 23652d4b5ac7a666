"""References that must not answer a query."""

import numpy as np
import pytest

from aprjax.batch import match_batch
from aprjax.references import ReferenceSet, checked_ids
from tests.worlds import office, scan_at

PLACES = np.array([[12.0, 0.0, 0.3], [12.3, 0.1, 0.1], [6.0, 0.2, 0.0], [18.0, 0.0, 2.0]])
QUERY = np.array([12.1, 0.1, 0.2])


@pytest.fixture(scope="module")
def scene():
    world = office(seed=3)
    scans = [scan_at(world, pose) for pose in (*PLACES, QUERY)]
    return ReferenceSet.build(scans[:4]), scans[4]


def test_an_excluded_reference_is_in_no_hypothesis_and_the_next_one_answers(scene):
    references, query = scene
    exclude = np.array([[-1, -1, -1, -1], [0, -1, -1, -1], [-1, 1, -1, -1], [0, 1, 2, 3]])
    # As many queries as other tests have, to share their compilation.
    many = np.tile(exclude, (5, 1))
    result = match_batch([query] * len(many), references, exclude=many)
    assert result.reference[0, 0] in (0, 1)
    assert result.reference[1, 0] == 1
    assert result.reference[2, 0] == 0
    for found, ids in zip(result.reference, many, strict=True):
        assert not np.isin(found[found >= 0], ids).any()
    assert result.valid[:3, 0].all()
    assert not result.valid[3].any()


@pytest.mark.parametrize("exclude", [np.array([1, 2]), np.zeros((2, 1), int), np.array([[0.5]])])
def test_what_is_no_array_of_ids_for_each_query_is_refused(scene, exclude):
    references, query = scene
    with pytest.raises(ValueError, match="exclude: "):
        match_batch([query], references, exclude=exclude)


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int64, np.uint64, object, float])
def test_ids_of_any_type_of_whole_numbers_are_the_same_and_none_may_have_any_type(kind):
    given = np.array([[0, 7], [1, 2]], kind) if kind is not float else np.empty((2, 0))
    ids = checked_ids("exclude", given)
    assert ids.dtype == np.int32
    np.testing.assert_array_equal(ids, given.astype(np.int32))


@pytest.mark.parametrize("wrong", [2**31, 2**32 + 7, 2**64 - 1])
def test_an_id_that_would_wrap_is_refused_by_its_index_and_value(wrong):
    for ids in (np.array([[wrong]], np.uint64), [[wrong]], np.array([[wrong]], object)):
        with pytest.raises(ValueError, match=rf"^exclude\[0, 0\]: {wrong} is no id$"):
            checked_ids("exclude", ids)
