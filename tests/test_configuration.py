import copy
import dataclasses
import importlib
import json
import pickle
import pkgutil

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import aprjax
from aprjax.alignment.align import AlignmentConfig
from aprjax.anchors.extract import ExtractionConfig
from aprjax.configuration import Packed, from_dict, to_dict
from aprjax.features import FeatureConfig
from aprjax.matcher import MatchConfig
from aprjax.refine import RefineConfig, SettleConfig
from aprjax.relations.histograms import RelationConfig

CONFIGS = [ExtractionConfig(), RelationConfig(), AlignmentConfig(), FeatureConfig()]


def changed(config):
    """The configuration with every threshold another."""
    return jax.tree.map(lambda leaf: leaf * np.float32(1.25), config)


@pytest.mark.parametrize("config", CONFIGS, ids=lambda c: type(c).__name__)
def test_thresholds_are_float32_arrays_and_touch_no_device(config):
    leaves = jax.tree.leaves(config)
    assert leaves
    for leaf in leaves:
        assert isinstance(leaf, np.ndarray)
        assert leaf.dtype == np.float32
        assert leaf.shape == ()


@pytest.mark.parametrize("config", CONFIGS, ids=lambda c: type(c).__name__)
def test_a_configuration_survives_json(config):
    config = changed(config)
    back = from_dict(type(config), json.loads(json.dumps(to_dict(config))))
    assert eqx.tree_equal(back, config)


def test_an_array_given_for_a_threshold_is_copied():
    given = np.array(0.2, np.float32)
    config = MatchConfig(confident=given)
    given[...] = 7
    assert config.confident == np.float32(0.2)


def test_a_changed_capacity_survives_too():
    config = ExtractionConfig(anchors=5, apart=0.5)
    back = from_dict(ExtractionConfig, to_dict(config))
    assert back.anchors == 5
    assert float(back.apart) == 0.5


def test_fields_that_are_missing_keep_their_defaults():
    config = from_dict(ExtractionConfig, {"segment": {"gap": 0.5}})
    assert float(config.segment.gap) == 0.5
    assert eqx.tree_equal(config.surface, ExtractionConfig().surface)
    assert eqx.tree_equal(from_dict(ExtractionConfig, {}), ExtractionConfig())


@pytest.mark.parametrize("values", [{"nonsense": 1.0}, {"segment": {"nonsense": 1.0}}])
def test_an_unknown_field_is_refused_by_name(values):
    with pytest.raises(ValueError, match="nonsense"):
        from_dict(ExtractionConfig, values)


def test_a_table_where_a_number_belongs_is_refused_by_name():
    with pytest.raises(ValueError, match="apart"):
        from_dict(ExtractionConfig, {"apart": {"x": 1.0}})


@pytest.mark.parametrize(
    "value",
    [1, 0.5, np.float64(0.5), np.float32(0.5), np.array(2), jnp.float32(0.5), jnp.asarray(0.5)],
    ids=lambda v: type(v).__name__,
)
def test_a_threshold_of_any_number_type_traces_once(value):
    traces = 0

    @jax.jit
    def gap(config):
        nonlocal traces
        traces += 1
        return config.apart

    gap(ExtractionConfig())
    assert float(gap(ExtractionConfig(apart=value))) == pytest.approx(float(value))
    assert traces == 1


def test_a_threshold_may_be_swept_and_differentiated():
    values = jnp.array([0.1, 0.2, 0.4])
    swept = jax.vmap(lambda value: ExtractionConfig(apart=value).apart * 2)(values)
    np.testing.assert_allclose(swept, 2 * values)
    assert float(jax.grad(lambda value: ExtractionConfig(apart=value).apart * 3)(1.0)) == 3


SIGNED = {"offset", "slope", "angle_min", "angle_increment"}
FROM_ZERO = {
    "RotationConfig.width",
    "RefineConfig.iterations",
    "SettleConfig.iterations",
    "RelationConfig.length_tolerance",
    "RelationConfig.part_tolerance",
}


def below(kind):
    """All kinds that derive from one, from those that do too."""
    return [each for own in kind.__subclasses__() for each in (own, *below(own))]


def fields_of_all(static):
    """Thresholds, or capacities, of every configuration of the package."""
    for module in pkgutil.walk_packages(aprjax.__path__, "aprjax."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    kinds = [kind for kind in below(eqx.Module) if kind.__module__.startswith("aprjax.")]
    found = [
        (kind, field.name, field.default)
        for kind in kinds
        for field in dataclasses.fields(kind)
        if "doc" in field.metadata and field.metadata.get("static", False) == static
    ]
    assert {SettleConfig, RefineConfig} < {kind for kind, _, _ in found}
    return found


def test_every_threshold_is_a_finite_number_and_none_below_zero_but_those_of_any_sign():
    for kind, name, default in fields_of_all(static=False):
        assert float(getattr(kind(), name)) == np.float32(default)
        for value in (np.nan, np.inf, -np.inf, 1e39, "1", None, True, [[1.0], [1.0, 2.0]]):
            with pytest.raises(ValueError, match=f"^{name}: .* is not a"):
                kind(**{name: value})
        with pytest.raises(ValueError, match=rf"^{name}\[1\]: nan is not a"):
            kind(**{name: np.array([default, np.nan])})
        if name not in SIGNED:
            with pytest.raises(ValueError, match=rf"^{name}: -1\.0 is not a .*number from \d"):
                kind(**{name: -1.0})
            with pytest.raises(ValueError, match=rf"^{name}\[2\]: -1\.0 is not a .*number from \d"):
                kind(**{name: [default, default, -1.0]})


def test_the_ends_of_a_range_are_in_it_and_what_is_beyond_is_refused():
    """As float32: π, rounded to it, is more than π."""
    bounded = set()
    for kind, name, _ in fields_of_all(static=False):
        if kind.__module__.startswith("aprjax.sim"):  # refuses zeros in its own words
            continue
        (field,) = (field for field in dataclasses.fields(kind) if field.name == name)
        least, most = field.metadata["least"], field.metadata["most"]
        for end, beyond in ((least, least - 1), (most, most + 1)):
            if np.isfinite(end):
                bounded.add(name)
                assert getattr(kind(**{name: end}), name) == np.float32(end)
                assert getattr(kind(**{name: np.float32(end)}), name) == np.float32(end)
                with pytest.raises(ValueError, match=f"^{name}: .* is not a"):
                    kind(**{name: beyond})
    assert {"weight", "angle", "min_quality", "incidence", "trust"} <= bounded


@pytest.mark.parametrize(
    "values",
    [
        {"alignment": {"correspondence": {"angle": 3.2}}},
        {"shortlist": {"angle": 3.2}},
        {"distinctiveness": {"angle": 3.2}},
        {"distinctiveness": {"weight": 1.1}},
        {"distinctiveness": {"contradiction": 1.1}},
        {"distinctiveness": {"harmony": 1.1}},
        {"confident": 1.1},
        {"min_quality": 1.1},
    ],
    ids=str,
)
def test_an_angle_beyond_half_a_turn_and_a_share_beyond_all_are_refused(values):
    """A cosine would take the angle for a smaller one."""
    with pytest.raises(ValueError, match=r": (3\.2|1\.1) is not a number from 0 to (3\.14159|1)$"):
        from_dict(MatchConfig, values)


@pytest.mark.parametrize("stage", ["segment", "virtual_edge"])
def test_an_angle_with_a_surface_beyond_a_right_one_is_refused(stage):
    name = {"segment": "incidence", "virtual_edge": "min_angle"}[stage]
    with pytest.raises(ValueError, match=f"^{name}: 1.6 is not a number from .* to 1.5708"):
        from_dict(ExtractionConfig, {stage: {name: 1.6}})


def test_what_divides_is_never_zero():
    for name in ("gate", "final_gate", "bias", "roughness", "outlier", "trust", "prior"):
        with pytest.raises(ValueError, match=f"^{name}: 0 is not a finite number from"):
            RefineConfig(**{name: 0})


def test_every_capacity_is_a_whole_number_from_one_but_a_few_from_zero():
    for kind, name, default in fields_of_all(static=True):
        if isinstance(default, bool):
            with pytest.raises(ValueError, match=f"^{name}: 1 is not True or False"):
                kind(**{name: 1})
            continue
        low = 0 if f"{kind.__name__}.{name}" in FROM_ZERO else 1
        assert getattr(kind(**{name: default}), name) == default
        for value in (low - 1, -5, 2.5, np.nan, True, "8", [8]):
            with pytest.raises(ValueError, match=f"^{name}: .* is not a whole number from {low}"):
                kind(**{name: value})


def test_whole_numbers_of_numpy_are_capacities():
    config = MatchConfig(hypotheses=np.int64(3), top_k=np.uint8(4), cascade=np.bool_(False))
    assert (config.hypotheses, config.top_k, config.cascade) == (3, 4, False)
    assert json.loads(json.dumps(to_dict(config)))["top_k"] == 4


def test_leaves_that_jax_puts_into_a_configuration_are_not_looked_at():
    config = RefineConfig()
    assert jax.tree.map(lambda leaf: -leaf, config).gate < 0
    assert eqx.tree_at(lambda c: c.gate, config, -1.0).gate == -1.0
    assert jax.tree.unflatten(jax.tree.structure(config), [None] * 11).gate is None
    assert jnp.isnan(dataclasses.replace(config, gate=jnp.float32(np.nan)).gate)
    swept = jax.vmap(lambda value: RefineConfig(gate=value).gate)(jnp.array([-1.0, np.nan]))
    assert swept[0] == -1.0


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda packed: pickle.loads(pickle.dumps(packed))]
)
def test_a_copy_of_a_packed_configuration_is_the_same_to_a_program(copied):
    @jax.jit
    def program(packed):
        traced.append(packed)
        return packed.config.refine.gate

    traced = []
    packed = Packed.of(dataclasses.replace(MatchConfig(), refine=RefineConfig(gate=0.3)))
    for each in (packed, copied(packed), copied(jax.device_put(packed))):
        assert program(each) == np.float32(0.3)
    assert len(traced) == 1


def test_a_packed_configuration_has_single_numbers_or_is_refused_by_its_name():
    several = RefineConfig(gate=np.array([0.3, 0.4]))
    with pytest.raises(ValueError, match=r"^config\.align\.gate: shape \(2,\) is not a single"):
        Packed.of(several, "config.align")


def test_a_dictionary_is_refused_as_the_constructor_refuses():
    for values, message in (
        ({"refine": {"cluster": -1.0}}, "^cluster: -1.0 is not a finite number from 0"),
        ({"probability": {"slope": float("nan")}}, "^slope: nan is not a finite number$"),
        ({"hypotheses": 0}, "^hypotheses: 0 is not a whole number from 1"),
        ({"refine": 2.0}, "^refine: 2.0 is not a group of fields"),
    ):
        with pytest.raises(ValueError, match=message):
            from_dict(MatchConfig, values)
