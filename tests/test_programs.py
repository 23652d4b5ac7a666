"""Programs that are kept for later processes: here, for other `Program`s of the same function."""

import gc
import subprocess
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export
from jaxtyping import Array, Float

from aprjax import batch, describing, programs
from aprjax.batch import match_batch
from aprjax.configuration import Packed
from aprjax.features import FeatureConfig, Features
from aprjax.programs import Program, keep_traces, surroundings
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from tests.worlds import free_pose, office, scan_at

ROOT = Path(__file__).resolve().parents[1]


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


def test_what_a_program_returns_is_the_same_to_the_next_one_in_this_process_and_in_later_ones(
    folder,
):
    def sign(numbers):
        return Inner(jnp.where(numbers > 0, 1.0, -1.0))  # weakly typed: of Python's numbers

    def twice(inner):
        return Inner(2 * inner.twice)

    for _ in range(2):
        Program(twice, Inner)(Program(sign, Inner)(NUMBERS))
        assert len(list(folder.iterdir())) == 2


def test_features_have_the_types_of_their_arrays_and_not_of_python_s_numbers():
    scan = Scan.stack([scan_at(office(seed=2), np.zeros(3))])
    made = jax.jit(describing._describe_chunk)(scan, Packed.of(FeatureConfig()))
    assert not [leaf.aval for leaf in jax.tree.leaves(made) if leaf.weak_type]


@pytest.mark.parametrize("damage", ["empty", "short", "changed"])
def test_a_damaged_file_is_written_anew(fresh, folder, damage):
    fresh()(NUMBERS, factor=3)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes({"empty": b"", "short": whole[:20], "changed": whole[:-1] + b"?"}[damage])
    assert is_right(fresh()(NUMBERS, factor=3), NUMBERS, 3)
    fresh()(NUMBERS, factor=3)
    assert fresh.traced == 2
    assert list(folder.iterdir()) == [path]


def test_a_folder_that_takes_no_file_is_warned_about_and_the_answer_given(fresh, folder):
    keep_traces(folder / "gone")
    with pytest.warns(UserWarning, match="not kept for later processes"):
        assert is_right(fresh()(NUMBERS, factor=3), NUMBERS, 3)
    assert fresh.traced == 1


def test_a_trace_that_does_not_run_here_is_warned_about_once_and_done_without(
    fresh, folder, monkeypatch
):
    like = jax.ShapeDtypeStruct(NUMBERS.shape, NUMBERS.dtype)
    foreign = export.export(jax.jit(lambda n: [jnp.sum(n), n]), platforms=["cuda"])(like)
    monkeypatch.setattr(programs, "_load", lambda path: foreign)
    program = fresh()
    with pytest.warns(UserWarning, match="without its trace from now on"):
        assert is_right(program(NUMBERS, factor=3), NUMBERS, 3)
    assert is_right(program(NUMBERS, factor=3), NUMBERS, 3)
    assert program.compiled == 1


def test_what_cannot_be_exported_is_traced_in_each_process(fresh, folder, monkeypatch):
    def refuse(*_, **__):
        raise ValueError("no stable form")

    monkeypatch.setattr(export, "export", refuse)
    for traces in (1, 2):
        with pytest.warns(UserWarning, match="no stable form"):
            assert is_right(fresh()(NUMBERS, factor=3), NUMBERS, 3)
        assert fresh.traced == traces
    assert not list(folder.iterdir())


def test_a_process_after_it_traces_nothing_and_says_the_same(tmp_path):
    script = """
import sys
from pathlib import Path
import jax.numpy as jnp
import numpy as np
from aprjax.programs import Program, keep_traces
from tests.test_programs import Inner

def thrice(numbers):
    print("traced", file=sys.stderr)
    return Inner(3 * jnp.sin(numbers))

keep_traces(Path(sys.argv[1]))
print(np.asarray(Program(thrice, Inner)(np.arange(3, dtype=np.float32)).twice).tobytes().hex())
"""
    command = [sys.executable, "-c", script, str(tmp_path)]
    runs = [
        subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert [run.stderr.count("traced") for run in runs] == [1, 0]
    assert runs[0].stdout == runs[1].stdout


@pytest.mark.parametrize("name", ["code.py", "numbers.npz"])
def test_other_code_or_data_of_the_package_is_another_program(tmp_path, name):
    (tmp_path / "code.py").write_text("one")
    (tmp_path / "numbers.npz").write_bytes(b"two")
    before = surroundings(tmp_path)
    assert surroundings(tmp_path) == before
    (tmp_path / name).write_text("three")
    assert surroundings(tmp_path) != before


def test_what_is_no_plain_array_is_jitted_as_it_is(fresh, folder):
    program = fresh()
    assert float(program(2.0, factor=3).total) == 6.0
    assert is_right(program(NUMBERS, 3), NUMBERS, 3)  # static, by position
    assert float(program(jnp.asarray(2.0), factor=3).total) == 6.0  # of a weak type
    with jax.disable_jit():
        assert is_right(program(NUMBERS, factor=3), NUMBERS, 3)
    assert not list(folder.iterdir())


def test_a_result_that_is_not_as_declared_is_made_without_a_trace(folder):
    def makes_an_inner(numbers):
        return Inner(2 * numbers)

    with pytest.warns(UserWarning, match="its result is not made of arrays as"):
        made = Program(makes_an_inner, Outcome)(NUMBERS)  # pyright: ignore[reportArgumentType]
    assert np.array_equal(made.twice, 2 * NUMBERS)


def test_several_threads_share_one_trace(fresh, folder):
    program = fresh()
    with ThreadPoolExecutor(4) as pool:
        outcomes = list(pool.map(lambda n: program(NUMBERS + n, factor=3), range(8)))
    assert all(is_right(outcome, NUMBERS + n, 3) for n, outcome in enumerate(outcomes))
    assert fresh.traced == 1


def test_answers_by_a_trace_are_those_without_to_the_bit(folder):
    rng, world = np.random.default_rng(0), office(seed=2)
    scans = [scan_at(world, free_pose(world, rng), rng=rng) for _ in range(6)]
    features = Program(describing._describe_chunk, Features)
    matching = Program(batch._match_chunk, batch._Words, static=("together",))
    answers = []
    for where in (None, folder):
        keep_traces(where)
        with pytest.MonkeyPatch.context() as patched:
            for module in (describing, batch):
                patched.setattr(module, "describe_chunk", again(features))
            patched.setattr(batch, "_match_program", again(matching))
            answers.append(match_batch(scans[:2], ReferenceSet.build(scans)))
    assert len(list(folder.glob("*.trace"))) == 2
    assert np.asarray(answers[0].valid).any()
    assert eqx.tree_equal(*answers, typematch=True)


def again(program: Program) -> Program:
    """The program as a new process would have it."""
    return Program(program._function, program._returns, program._static)


def mappings():
    return Path("/proc/self/maps").read_bytes().count(b"\n")


@pytest.mark.skipif(not programs._LIMIT.exists(), reason="Linux alone bounds memory mappings")
@pytest.mark.parametrize("kept", [False, True])
def test_forgotten_programs_give_their_memory_mappings_back(kept, tmp_path):
    def long(numbers):
        for factor in range(40):
            numbers = jnp.sort(jnp.sin(numbers) * factor) + jnp.cumsum(numbers)
        return Outcome(jnp.sum(numbers), Inner(numbers))

    keep_traces(tmp_path if kept else None)
    try:
        program = Program(long, Outcome)
        program(NUMBERS)
        program.forget()
        gc.collect()
        before = mappings()
        for length in range(4, 8):
            program(np.ones(length, np.float32))
        taken = mappings() - before
        assert program.compiled == 4
        program.forget()
        gc.collect()
        assert program.compiled == 0
        assert mappings() - before < 0.5 * taken
    finally:
        keep_traces(None)


@pytest.mark.parametrize("kept", [False, True])
def test_where_room_is_short_programs_are_forgotten_and_answer_as_before(
    kept, fresh, tmp_path, monkeypatch
):
    keep_traces(tmp_path if kept else None)
    monkeypatch.setattr(programs, "_programs", weakref.WeakSet())
    monkeypatch.setattr(programs, "_FEW", 2)
    try:
        program, other = fresh(), fresh()
        for length in (1, 2):
            program(np.ones(length, np.float32), factor=2.0)
        monkeypatch.setattr(programs, "_crowded", lambda: True)
        assert program.compiled == 2
        assert other(NUMBERS, factor=2.0).total == 2.0 * NUMBERS.sum()
        assert (program.compiled, other.compiled) == (0, 0)
        for _ in range(3):
            assert program(np.ones(2, np.float32), factor=2.0).total == 4.0
        assert program.compiled == 1
        assert fresh.traced == (3 if kept else 4)
    finally:
        keep_traces(None)


def test_a_process_is_crowded_by_its_mappings_and_where_none_are_told_it_is_not(tmp_path):
    maps, limit = tmp_path / "maps", tmp_path / "limit"
    assert not programs._crowded(0.7, maps, limit)
    limit.write_text("100\n")
    for lines, crowded in ((60, False), (80, True)):
        maps.write_text("7f00 r-xp\n" * lines)
        assert programs._crowded(0.7, maps, limit) is crowded
