import jax
import pytest

from aprjax.configuration import from_dict, to_dict
from aprjax.features import FeatureConfig
from aprjax.matcher import MatchConfig
from experiments.defaults import REASONS, Setting, settings

CONFIG = {"features": to_dict(FeatureConfig()), "match": to_dict(MatchConfig())}
ALL = list(settings(CONFIG))
VARIED = [setting for setting in ALL if setting.reason is None]


def test_every_threshold_is_there_and_a_capacity_too():
    thresholds = sum(not setting.capacity for setting in ALL)
    assert thresholds == len(jax.tree.leaves((FeatureConfig(), MatchConfig())))
    assert Setting(("match", "alignment", "maxima"), MatchConfig().alignment.maxima) in VARIED


def test_every_reason_belongs_to_a_setting():
    assert {setting.name for setting in ALL} >= REASONS.keys()


@pytest.mark.parametrize("setting", VARIED, ids=lambda setting: setting.name)
def test_scaling_makes_a_valid_configuration_that_differs_in_one_setting(setting):
    for factor in (0.5, 2.0):
        config = setting.scaled(CONFIG, factor)
        pairs = zip(settings(config), ALL, strict=True)
        assert [old.path for new, old in pairs if new != old] == [setting.path]
        match = from_dict(MatchConfig, config["match"])
        features = from_dict(FeatureConfig, config["features"])
        assert to_dict(match).keys() == CONFIG["match"].keys()
        assert to_dict(features).keys() == CONFIG["features"].keys()


def test_capacities_stay_whole_and_thresholds_double():
    config = {"stage": {"size": 5, "width": 0.5}}
    size, width = settings(config)
    assert size.scaled(config, 0.5) == {"stage": {"size": 2, "width": 0.5}}
    assert width.scaled(config, 2.0) == {"stage": {"size": 5, "width": 1.0}}
    assert config == {"stage": {"size": 5, "width": 0.5}}


@pytest.mark.parametrize("value", [None, True, 0.0, 0])
def test_what_is_no_number_or_zero_is_left_out(value):
    assert Setting(("stage", "size"), value).reason


def test_a_setting_is_below_itself_and_what_it_is_part_of():
    setting = Setting(("match", "alignment", "agreement"), 0.25)
    assert all(map(setting.is_below, ("match", "match.alignment", "match.alignment.agreement")))
    assert not any(map(setting.is_below, ("", "features", "match.align", "match.alignment.ag")))
