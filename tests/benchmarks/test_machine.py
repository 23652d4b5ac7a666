import pytest

from benchmarks.machine import NOMINAL, NOMINAL_CORES, Probe, machine_name, peak, probe


def test_the_nominal_machine_has_slowness_one():
    nominal = Probe(NOMINAL, NOMINAL, NOMINAL / NOMINAL_CORES)
    assert nominal.slowness("one") == pytest.approx(1)
    assert nominal.slowness("all") == pytest.approx(1)


def test_slowness_grows_with_the_probes_time_and_cores_count_for_all_only():
    slow = Probe(4 * NOMINAL, NOMINAL, NOMINAL)
    assert slow.slowness("one") == pytest.approx(2)
    assert slow.slowness("all") == pytest.approx(NOMINAL_CORES)


def test_the_probe_takes_time():
    found = probe(repeats=1)
    assert min(found.numpy, found.jax, found.jax_all) > 0


def test_the_peak_is_positive_and_the_machine_has_a_name():
    found = peak(repeats=1)
    assert min(found.flops, found.bytes) > 0
    assert "jax" in machine_name()
    assert "\n" not in machine_name()
