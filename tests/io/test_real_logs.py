"""The public logs, read whole."""

import numpy as np
import pytest

from aprjax.io.logs import read_log

# Scans, beams, degrees a step, saturation, longest range that is a hit.
LOGS = {
    "aces-corrected": (440, 180, 1.0, 50.0, 50.0),
    "belgioioso-corrected": (395, 361, 0.5, None, 80.99),
    "csail-corrected": (406, 361, 0.5, None, 50.0),
    "fhw-corrected": (488, 180, 1.0, 51.05, 51.05),
    "freiburg-079-corrected": (4791, 360, 0.5, None, 80.99),
    "intel-corrected": (910, 180, 1.0, None, 80.0),
    "fr079.graph": (1464, 360, 0.5, None, 50.0),
    "intel-lab.graph": (2672, 180, 1.0, None, 50.0),
    "mit-csail.graph": (1051, 361, 0.5, None, 50.0),
}


@pytest.mark.parametrize("name", LOGS)
def test_a_log_holds_what_its_readme_says(data, name):
    scans, beams, degrees, saturation, range_max = LOGS[name]
    log = read_log(data / "logs" / f"{name}.log.gz", strict=True)
    report = log.report
    assert (report.scans, report.saturation, report.damaged_lines) == (scans, saturation, 0)
    assert report.unknown == ({"NEFF": scans} if name.endswith("-corrected") else {})
    assert report.vertices == (0 if name.endswith("-corrected") else scans)
    entry = next(iter(log))
    assert entry.scan.beams == beams
    assert entry.scan.range_max == np.float32(range_max)
    step = np.degrees(entry.scan.angle_increment)
    np.testing.assert_allclose(step, degrees, atol=1e-4)


@pytest.mark.parametrize("name", ["aces", "belgioioso", "csail", "fhw", "intel"])
def test_odometry_of_a_corrected_log_is_the_raw_odometry(data, name):
    log = read_log(data / "logs" / f"{name}-corrected.log.gz")
    raw = read_log(data / "maps" / name / "build.log.gz")
    got, expected = (np.array([entry.odometry for entry in each]) for each in (log, raw))
    np.testing.assert_allclose(got[:, :2], expected[:, :2], atol=2e-4)
    turn = (got - expected)[:, 2]
    np.testing.assert_allclose(np.exp(1j * turn), 1, atol=1e-5)


@pytest.mark.parametrize("name", ["aces.interleaved", "fhw.revisit"])
@pytest.mark.parametrize("part", ["references", "queries"])
def test_parts_of_a_log_saturate_as_the_whole(data, name, part):
    log = read_log(data / "splits" / name / f"{part}.log.gz")
    assert log.report.saturation == {"aces": 50.0, "fhw": 51.05}[name.partition(".")[0]]


def test_codes_are_told_apart(data):
    """Intel's scanner says above maximum (81.83), Freiburg's says not valid (81.91)."""
    free = {"intel": 4172, "freiburg-079": 0}
    invalid = {"intel": 0, "freiburg-079": 36004}
    for name in free:
        ranges = [entry.scan.ranges for entry in read_log(data / f"logs/{name}-corrected.log.gz")]
        assert np.isposinf(ranges).sum() == free[name]
        assert np.isnan(ranges).sum() == invalid[name]
