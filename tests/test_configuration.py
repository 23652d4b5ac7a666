import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aprjax.alignment.align import AlignmentConfig
from aprjax.anchors.extract import ExtractionConfig
from aprjax.configuration import from_dict, to_dict
from aprjax.features import FeatureConfig
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
