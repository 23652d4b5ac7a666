import os
import stat

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache

from aprjax import batch, describing
from aprjax.anchors.extract import ExtractionConfig
from aprjax.batch import match, match_batch
from aprjax.compilation import cache_compilations, warm_up
from aprjax.features import FeatureConfig
from aprjax.matcher import MatchConfig
from aprjax.programs import keep_traces
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from tests.worlds import free_pose, office, scan_at

SETTINGS = (
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)


@pytest.fixture
def settings_restored():
    before = {name: getattr(jax.config, name) for name in SETTINGS}
    yield
    keep_traces(None)
    compilation_cache.reset_cache()
    for name, value in before.items():
        jax.config.update(name, value)


def test_after_warming_up_nothing_is_compiled():
    rng, world = np.random.default_rng(0), office(seed=2)
    scans = [scan_at(world, free_pose(world, rng), rng=rng) for _ in range(6)]
    config = FeatureConfig(extraction=ExtractionConfig(anchors=10))  # as no other test has it
    references = ReferenceSet.build([thinned(scan) for scan in scans], config)
    described = describing.describe_chunk.compiled
    warm_up(references, beams=181, batches=[1])
    assert describing.describe_chunk.compiled == described + 1
    compiled = batch._match_program.compiled
    assert np.asarray(match(scans[0], references).valid).any()
    assert describing.describe_chunk.compiled == described + 1
    assert batch._match_program.compiled == compiled


def thinned(scan):
    """The scan with every second beam."""
    return Scan.make(
        scan.ranges[::2],
        angle_min=scan.angle_min,
        angle_increment=2 * scan.angle_increment,
        range_max=scan.range_max,
    )


def test_a_few_queries_and_many_are_a_program_each_whatever_their_number():
    rng, world = np.random.default_rng(0), office(seed=2)
    scans = Scan.stack([scan_at(world, free_pose(world, rng), rng=rng) for _ in range(6)])
    references, cores = ReferenceSet.build(scans), os.cpu_count() or 1
    config = MatchConfig(hypotheses=3, chunk=2)  # as no other test has it
    before, counts = batch._match_program.compiled, []
    for few in range(1, min(2 * cores, 6)):
        match_batch(jax.tree.map(lambda array: array[:few], scans), references, config)  # noqa: B023
        described = describing.describe_chunk.compiled
        counts.append(batch._match_program.compiled - before)
    for extra in range(3):
        rows = np.arange(2 * cores + extra) % 6
        many = jax.tree.map(lambda array: array[rows], scans)  # noqa: B023
        match_batch(many, references, config)
        counts.append(batch._match_program.compiled - before)
    assert counts == [1] * (len(counts) - 3) + [2] * 3
    assert describing.describe_chunk.compiled <= described + 1


@pytest.mark.parametrize(("beams", "batches"), [(0, [1]), (181, [1, 0])])
def test_sizes_that_are_not_positive_are_refused_by_name(beams, batches):
    with pytest.raises(ValueError, match=r"(beams\[0\]|batches\[1\]): 0"):
        warm_up(None, beams=beams, batches=batches)  # pyright: ignore[reportArgumentType]


@pytest.mark.usefixtures("settings_restored")
def test_the_cache_is_the_users_alone_and_takes_small_programs(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = cache_compilations()
    assert folder == tmp_path / "aprjax"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert jax.config.jax_compilation_cache_dir == str(folder)
    assert jax.config.jax_persistent_cache_min_compile_time_secs == 0


@pytest.mark.usefixtures("settings_restored")
def test_programs_land_in_the_folder_named_last(tmp_path):
    for name in ("first", "second"):
        cache_compilations(tmp_path / name)
        jax.jit(lambda x: jnp.sin(x) * len(name))(jnp.ones(3))  # noqa: B023
        assert list((tmp_path / name).iterdir())


@pytest.mark.usefixtures("settings_restored")
def test_the_home_folder_may_be_a_tilde(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_compilations("~/compiled") == tmp_path / "compiled"


@pytest.mark.usefixtures("settings_restored")
def test_a_folder_that_others_can_write_to_is_refused(tmp_path):
    before = jax.config.jax_compilation_cache_dir
    tmp_path.chmod(0o777)
    with pytest.raises(PermissionError, match="others can write"):
        cache_compilations(tmp_path)
    assert jax.config.jax_compilation_cache_dir == before
