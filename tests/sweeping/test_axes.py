import re

import numpy as np
import pytest

from aprjax.features import FeatureConfig
from aprjax.matcher import MatchConfig
from aprjax.sweeping.axes import check_names, check_values, configured, product, thresholds


def test_thresholds_are_found_by_dotted_name_and_capacities_are_not():
    found = thresholds(MatchConfig())
    assert found["congruence.quality.doubt"] == np.float32(0.1)
    assert "min_quality" in found
    assert not {"top_k", "cascade", "shortlist.kept", "congruence"} & found.keys()


def test_all_combinations_come_with_the_last_axis_fastest():
    columns = product({"a": [1, 2], "b": np.array([3.0, 4.0, 5.0])})
    assert columns["a"].tolist() == [1, 1, 1, 2, 2, 2]
    assert columns["b"].tolist() == [3, 4, 5, 3, 4, 5]


@pytest.mark.parametrize("values", [[], [1.0, np.nan], [np.inf], [[1.0]], 1.0])
def test_an_axis_without_finite_values_is_refused_by_name(values):
    with pytest.raises(ValueError, match=r"^a: "):
        product({"a": values})


def test_no_axis_is_refused():
    with pytest.raises(ValueError, match="axes: there is none"):
        product({})


def test_a_configuration_gets_thresholds_and_keeps_the_rest():
    config = configured(MatchConfig(), {"congruence.quality.doubt": [0.1, 0.2], "confident": 0.5})
    assert config.congruence.quality.doubt.shape == (2,)
    assert config.congruence.quality.doubt.dtype == np.float32
    assert config.confident == np.float32(0.5)
    assert config.congruence.tolerance == MatchConfig().congruence.tolerance


@pytest.mark.parametrize("value", [[0.1, -1.0], np.array([0.1, np.nan]), [0.1, np.inf]])
def test_a_value_out_of_a_threshold_s_range_is_refused_by_its_index(value):
    with pytest.raises(
        ValueError, match=r"^congruence\.quality\.doubt\[1\]: .* is not a finite number from 0"
    ):
        configured(MatchConfig(), {"congruence.quality.doubt": value})


@pytest.mark.parametrize("name", ["congruence.tolerance", "features.extraction.surface.window"])
def test_a_value_along_an_axis_is_refused_by_the_axis_and_its_index(name):
    check_values(name, np.array([0.1, 0.2]))
    with pytest.raises(ValueError, match=rf"^{re.escape(name)}\[1\]: -1\.0 is not"):
        check_values(name, np.array([0.1, -1.0]))


def test_values_that_switch_a_part_off_are_thresholds():
    features = configured(
        FeatureConfig(),
        {"extraction.jump_edge.jump": 1e3, "extraction.angle.min_angle": 4.0},
    )
    assert features.extraction.angle.min_angle == 4.0
    config = configured(
        MatchConfig(),
        {"refine.gate": 1e-6, "distinctiveness.equal": 1e3, "distinctiveness.weight": 0.0},
    )
    assert config.distinctiveness.equal == 1e3


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("congruence.tolerence", r"no such threshold; near it: congruence\.tolerance"),
        ("tolerance", r"near it: congruence\.tolerance"),
        ("congruence.quality", r"is a stage, with doubt, contradiction"),
        ("top_k", r"is a capacity"),
        ("cascade", r"is a capacity"),
        ("voting.places", r"is a capacity"),
        ("features.extraction.anchors", r"is a capacity"),
        ("features.view", r"is a stage|is a capacity|no such threshold"),
        ("features.extraction.surface.windo", r"near it: features\.extraction\.surface\.window"),
        ("__class__", "no such threshold"),
        ("", "no such threshold"),
    ],
)
def test_what_is_no_threshold_is_named_with_the_reason(name, said):
    with pytest.raises(ValueError, match=rf"^{name}: .*({said})"):
        check_names([name])


def test_every_threshold_of_both_configurations_is_accepted():
    check_names(thresholds(MatchConfig()))
    check_names(f"features.{name}" for name in thresholds(FeatureConfig()))
