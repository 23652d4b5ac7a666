import networkx as nx
import numpy as np
import pytest

from aprjax.places.neural_gas import NeuralGas, NeuralGasConfig
from tests.oracles import neural_gas as oracle


def two(config=None, first=(0.0, 0.0), second=(1.0, 0.0)):
    return NeuralGas.start(np.array(first), np.array(second), config or NeuralGasConfig())


def graph(gas):
    result = nx.Graph()
    result.add_nodes_from(np.flatnonzero(gas.alive).tolist())
    result.add_edges_from(gas.edges.tolist())
    return result


def circle(rng, count, centre, radius=1.0, noise=0.02):
    angle = rng.uniform(0, 2 * np.pi, count)
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return centre + ring + rng.normal(0, noise, (count, 2))


@pytest.mark.parametrize("oldest", [1, 20])
def test_every_step_is_fritzkes(oldest):
    rng = np.random.default_rng(oldest)
    config = NeuralGasConfig(neurons=12, interval=7, oldest=oldest, neighbour_rate=0.01)
    signals = rng.normal(size=(400, 3)) + 4 * rng.integers(0, 2, (400, 1))
    gas = NeuralGas.start(signals[0], signals[1], config)
    plain = oracle.Gas(signals[0], signals[1], config)
    removed, most = False, 0
    for signal in signals:
        before = int(gas.alive.sum())
        gas.show(signal)
        plain.show(signal.tolist())
        removed |= int(gas.alive.sum()) < before
        most = max(most, int(gas.alive.sum()))
        assert set(np.flatnonzero(gas.alive)) == set(plain.weight)
        assert {frozenset(edge): gas.ages[tuple(edge)] for edge in gas.edges.tolist()} == plain.age
        for unit, weight in plain.weight.items():
            np.testing.assert_allclose(gas.weights[unit], weight, atol=1e-9)
            np.testing.assert_allclose(gas.errors[unit], plain.error[unit], rtol=1e-9)
    assert most == 12
    assert removed == (oldest == 1)


def test_the_nearest_neuron_takes_the_error_and_moves_and_its_neighbours_follow():
    config = NeuralGasConfig(nearest_rate=0.1, neighbour_rate=0.01, decay=1.0)
    gas = two(config)
    gas.show(np.array([0.0, 1.0]))
    np.testing.assert_allclose(gas.errors[:2], [1.0, 0.0])
    np.testing.assert_allclose(gas.weights[:2], [[0.0, 0.1], [1.0, 0.0]])  # no neighbour yet
    assert gas.ages[0, 1] == gas.ages[1, 0] == 0
    gas.show(np.array([0.0, 1.0]))
    np.testing.assert_allclose(gas.weights[1], [0.99, 0.01])


def test_edges_age_by_one_and_are_renewed_between_nearest_and_second():
    gas = NeuralGas.start(np.zeros(1), np.ones(1), NeuralGasConfig())
    gas.weights[2], gas.alive[2] = 5.0, True
    gas.ages[0, 2] = gas.ages[2, 0] = 3
    gas.show(np.array([0.1]))
    assert gas.ages[0, 2] == gas.ages[2, 0] == 4
    assert gas.ages[0, 1] == 0
    assert gas.ages[1, 2] == -1


def test_an_edge_past_its_age_goes_and_with_it_a_neuron_left_alone():
    gas = NeuralGas.start(np.zeros(1), np.ones(1), NeuralGasConfig(oldest=5))
    gas.weights[2], gas.alive[2], gas.errors[2] = 5.0, True, 7.0
    gas.ages[0, 2] = gas.ages[2, 0] = 4
    gas.show(np.array([0.1]))
    assert gas.alive[2]
    gas.show(np.array([0.1]))
    assert not gas.alive[2]
    assert gas.ages[0, 2] == -1
    assert gas.errors[2] == 0.0
    assert gas.alive[:2].all()


def test_a_neuron_is_inserted_between_the_worst_and_its_worst_neighbour():
    config = NeuralGasConfig(interval=1, split_decay=0.5, decay=0.9, nearest_rate=1e-9)
    gas = two(config)
    gas.show(np.array([0.0, 2.0]))
    np.testing.assert_allclose(gas.weights[2], [0.5, 0.0], atol=1e-6)
    assert gas.ages[0, 1] == -1
    assert gas.ages[0, 2] == gas.ages[1, 2] == 0
    np.testing.assert_allclose(gas.errors[:3], 0.9 * np.array([2.0, 0.0, 2.0]))


def test_errors_decay_with_every_signal():
    gas = two(NeuralGasConfig(decay=0.5))
    gas.errors[:2] = (8.0, 4.0)
    gas.show(np.array([0.0, 0.0]))
    np.testing.assert_allclose(gas.errors[:2], [4.0, 2.0])


def test_the_capacity_is_never_passed_and_is_used_up():
    rng = np.random.default_rng(0)
    gas = NeuralGas.train(rng.uniform(size=(500, 2)), 0, NeuralGasConfig(neurons=30, passes=8))
    assert gas.alive.sum() == 30
    assert gas.weights.shape == (30, 2)


def test_on_a_circle_the_neurons_form_one_ring():
    features = circle(np.random.default_rng(0), 1500, np.zeros(2))
    config = NeuralGasConfig(neurons=40, passes=8, oldest=50)
    found = graph(NeuralGas.train(features, 0, config))
    assert nx.number_connected_components(found) == 1
    # One hole: neighbours along the ring, and no chord across.
    gas = NeuralGas.train(features, 0, config)
    ends = gas.weights[gas.edges]
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1).max() < 0.6
    assert np.all(np.linalg.norm(gas.weights[gas.alive], axis=1) > 0.85)
    assert all(degree >= 2 for _, degree in found.degree)


def test_clusters_far_apart_become_components_of_their_own():
    rng = np.random.default_rng(1)
    centres = np.array([(0.0, 0.0), (8.0, 0.0), (0.0, 8.0)])
    features = np.concatenate([circle(rng, 400, centre) for centre in centres])
    gas = NeuralGas.train(features, 3, NeuralGasConfig(neurons=45, passes=8, oldest=50))
    assert nx.number_connected_components(graph(gas)) == 3
    own = gas.classify(centres + np.array([1.0, 0.0]))
    assert len(set(own.tolist())) == 3
    assert not gas.alike(own[0], own[1])
    assert gas.alike(own, own).all()


def test_the_same_seed_gives_the_same_bits_and_another_seed_other_classes():
    features = np.random.default_rng(0).uniform(size=(200, 3))
    config = NeuralGasConfig(neurons=20, passes=3)
    first, again, other = (NeuralGas.train(features, seed, config) for seed in (4, 4, 5))
    assert first.weights.tobytes() == again.weights.tobytes()
    assert first.ages.tobytes() == again.ages.tobytes()
    assert first.weights.tobytes() != other.weights.tobytes()


def test_classify_gives_the_nearest_living_neuron_and_changes_nothing():
    rng = np.random.default_rng(0)
    gas = NeuralGas.train(rng.uniform(size=(100, 2)), 0, NeuralGasConfig(neurons=50, passes=2))
    before = gas.weights.copy(), gas.ages.copy()
    asked = rng.uniform(size=(20, 2))
    for row, found in zip(asked, gas.classify(asked), strict=True):
        living = np.flatnonzero(gas.alive)
        assert found == living[np.argmin(np.linalg.norm(gas.weights[living] - row, axis=1))]
    assert np.array_equal(gas.weights, before[0])
    assert np.array_equal(gas.ages, before[1])


@pytest.mark.parametrize(
    ("features", "message"),
    [
        (np.zeros((1, 3)), "1 views"),
        (np.zeros(3), r"shape \(3,\)"),
        (np.array([[0.0], [np.nan]]), r"features\[1, 0\]: nan"),
    ],
)
def test_training_refuses_what_it_cannot_use(features, message):
    with pytest.raises(ValueError, match=message):
        NeuralGas.train(features, 0)


def test_features_of_another_length_are_refused():
    with pytest.raises(ValueError, match=r"shape \(2, 3\)"):
        two().classify(np.zeros((2, 3)))


@pytest.mark.parametrize("field", ["neurons", "interval", "oldest", "passes"])
def test_a_configuration_without_sense_is_refused(field):
    with pytest.raises(ValueError, match=f"{field}: 0"):
        NeuralGasConfig(**{field: 0})
