"""Many arrays as one, and back."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.matcher import MatchConfig
from aprjax.packing import Packing
from aprjax.result import result_packing

FLOATS = np.array([[0.0, -0.0, np.inf], [-np.inf, np.nan, 1e-45]], np.float32)
TREE = {
    "counts": np.array([[1, -(2**31)], [2**31 - 1, 0]], np.int32),
    "empty": np.zeros((2, 0, 3), np.float32),
    "floats": FLOATS,
    "matrix": np.arange(12, dtype=np.float32).reshape(2, 2, 3),
    "one": np.array([True, False]),
}
PACKING = Packing(
    jax.tree.map(lambda array: jax.ShapeDtypeStruct(array.shape[1:], array.dtype), TREE)
)


def test_what_is_packed_and_unpacked_is_the_same_to_the_bit():
    words = np.asarray(jax.jit(PACKING.pack)(TREE))
    assert words.shape == (2, PACKING.words) == (2, 2 + 3 + 6 + 1)
    assert words.dtype == np.int32
    back = PACKING.unpack(words)
    for name, array in TREE.items():
        assert back[name].dtype == array.dtype, name
        assert back[name].tobytes() == array.tobytes(), name


def test_rows_are_unpacked_as_they_would_be_together():
    words = np.asarray(PACKING.pack(jax.tree.map(jnp.asarray, TREE)))
    last = PACKING.unpack(words[1:])
    jax.tree.map(lambda one, all_: np.testing.assert_array_equal(one, all_[1:]), last, TREE)


def test_a_single_row_may_come_without_its_axis_and_shares_no_memory_with_what_is_unpacked():
    words = np.array(PACKING.pack(jax.tree.map(jnp.asarray, TREE)))
    first = PACKING.unpack(words[0])
    words[:] = -1
    for name, array in TREE.items():
        np.testing.assert_array_equal(first[name], array[0], err_msg=name)
        assert np.shape(first[name]) == array.shape[1:], name


def test_words_of_another_layout_are_unpacked_and_those_of_another_length_refused():
    words = np.asarray(PACKING.pack(jax.tree.map(jnp.asarray, TREE)))
    back = PACKING.unpack(np.asfortranarray(words))
    jax.tree.map(np.testing.assert_array_equal, back, TREE)
    with pytest.raises(ValueError, match=f"rows of {2 * PACKING.words} are not of"):
        PACKING.unpack(np.hstack([words, words]))


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("matrix", np.zeros((2, 3, 2), np.float32)),
        ("floats", np.zeros((2, 3), np.int32)),
        ("floats", np.zeros((2, 3), np.float16)),
        ("another", np.zeros((2, 3), np.float32)),
    ],
)
def test_what_would_be_unpacked_as_something_else_is_not_packed(name, array):
    with pytest.raises(TypeError, match="not packed as"):
        PACKING.pack(TREE | {name: array})


def test_a_result_is_as_wide_as_the_hypotheses_that_are_asked_for():
    per_hypothesis = 1 + 3 + 9 + 3 + 2 + 1
    assert result_packing(3).words - result_packing(1).words == 2 * per_hypothesis
    assert result_packing(MatchConfig().hypotheses).words == 7 + 5 * per_hypothesis
