"""Many arrays as one, and back."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.matcher import MatchConfig
from aprjax.packing import pack, unpack
from aprjax.result import result_shapes

FLOATS = np.array([[0.0, -0.0, np.inf], [-np.inf, np.nan, 1e-45]], np.float32)
TREE = {
    "counts": np.array([[1, -(2**31)], [2**31 - 1, 0]], np.int32),
    "empty": np.zeros((2, 0, 3), np.float32),
    "floats": FLOATS,
    "matrix": np.arange(12, dtype=np.float32).reshape(2, 2, 3),
    "one": np.array([True, False]),
}
LIKE = jax.tree.map(lambda array: jax.ShapeDtypeStruct(array.shape[1:], array.dtype), TREE)


def test_what_is_packed_and_unpacked_is_the_same_to_the_bit():
    words = np.asarray(jax.jit(lambda tree: pack(tree, LIKE))(TREE))
    assert words.shape == (2, 2 + 3 + 6 + 1)
    assert words.dtype == np.int32
    back = unpack(words, LIKE)
    for name, array in TREE.items():
        assert back[name].dtype == array.dtype, name
        assert back[name].tobytes() == array.tobytes(), name


def test_rows_are_unpacked_as_they_would_be_together():
    words = np.asarray(pack(jax.tree.map(jnp.asarray, TREE), LIKE))
    last = unpack(words[1:], LIKE)
    jax.tree.map(lambda one, all_: np.testing.assert_array_equal(one, all_[1:]), last, TREE)


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
        pack(TREE | {name: array}, LIKE)


def test_a_result_is_as_wide_as_the_hypotheses_that_are_asked_for():
    def width(hypotheses):
        like = result_shapes(hypotheses)
        one = jax.tree.map(lambda leaf: jnp.zeros((1, *leaf.shape), leaf.dtype), like)
        return pack(one, like).shape[1]

    per_hypothesis = 1 + 3 + 9 + 3 + 2 + 1
    assert width(3) - width(1) == 2 * per_hypothesis
    assert width(MatchConfig().hypotheses) == 7 + 5 * per_hypothesis
