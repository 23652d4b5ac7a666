"""Programs that are kept for later processes: here, for other `Program`s of the same function."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export
from jaxtyping import Array, Float

from aprjax.features import FeatureConfig, Features, describe
from aprjax.programs import Program, keep_traces
from tests.worlds import free_pose, office, scan_at


class Inner(eqx.Module):
    twice: Float[Array, " n"]


class Outcome(eqx.Module):
    total: Float[Array, ""]
    inner: Inner


NUMBERS = np.arange(3.0, dtype=np.float32)


@pytest.fixture
def folder(tmp_path):
    keep_traces(tmp_path)
    yield tmp_path
    keep_traces(None)


@pytest.fixture
def fresh():
    """Makes the same program again, as a new process would; counts how often it is traced."""

    def make() -> Program[Outcome]:
        def doubled(numbers, factor):
            make.traced += 1
            return Outcome(jnp.sum(numbers) * factor, Inner(2 * numbers))

        return Program(doubled, Outcome, static=("factor",))

    make.traced = 0
    return make


def is_right(outcome: Outcome, numbers: np.ndarray, factor: int) -> bool:
    same = np.array_equal(outcome.inner.twice, 2 * numbers)
    return isinstance(outcome, Outcome) and same and float(outcome.total) == factor * numbers.sum()


def test_without_a_folder_nothing_is_written_and_each_process_traces(fresh, tmp_path):
    for traces in (1, 2):
        assert is_right(fresh()(NUMBERS, factor=3), NUMBERS, 3)
        assert fresh.traced == traces
    assert not list(tmp_path.iterdir())


def test_a_later_process_gives_the_same_without_tracing(fresh, folder):
    assert is_right(fresh()(NUMBERS, factor=3), NUMBERS, 3)
    assert fresh.traced == 1
    again = fresh()
    for numbers in (NUMBERS, NUMBERS + 1):
        assert is_right(again(numbers, factor=3), numbers, 3)
    assert fresh.traced == 1


def test_other_shapes_types_and_static_arguments_are_other_programs(fresh, folder):
    program = fresh()
    for numbers in (NUMBERS, np.arange(5, dtype=np.float32), np.arange(3, dtype=np.int32)):
        for factor in (2, 3):
            assert is_right(program(numbers, factor=factor), numbers, factor)
    assert len(list(folder.iterdir())) == 6


@pytest.mark.parametrize("damage", [b"", b"short", None])
def test_a_damaged_file_is_written_anew(fresh, folder, damage):
    fresh()(NUMBERS, factor=3)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + b"?" if damage is None else damage)
    assert is_right(fresh()(NUMBERS, factor=3), NUMBERS, 3)
    fresh()(NUMBERS, factor=3)
    assert fresh.traced == 2
    assert list(folder.iterdir()) == [path]


def test_a_folder_that_takes_no_file_is_warned_about_and_the_answer_given(fresh, folder):
    keep_traces(folder / "gone")
    with pytest.warns(UserWarning, match="not kept for later processes"):
        assert is_right(fresh()(NUMBERS, factor=3), NUMBERS, 3)


def test_what_cannot_be_exported_is_traced_in_each_process(fresh, folder, monkeypatch):
    def refuse(*_, **__):
        raise ValueError("no stable form")

    monkeypatch.setattr(export, "export", refuse)
    for traces in (1, 2):
        assert is_right(fresh()(NUMBERS, factor=3), NUMBERS, 3)
        assert fresh.traced == traces
    assert not list(folder.iterdir())


def test_features_from_a_kept_trace_are_those_of_a_new_one_to_the_bit(folder):
    rng, world = np.random.default_rng(0), office(seed=2)
    scan = scan_at(world, free_pose(world, rng), rng=rng)
    program, config = Program(describe, Features), FeatureConfig()
    new, kept = program(scan, config), Program(describe, Features)(scan, config)
    keep_traces(None)
    plain = Program(describe, Features)(scan, config)
    assert eqx.tree_equal(new, kept, typematch=True)
    assert eqx.tree_equal(plain, kept, typematch=True)
