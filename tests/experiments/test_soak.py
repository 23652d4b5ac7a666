import numpy as np

from experiments import soak


def test_twenty_simulated_minutes_of_failing_sources_leave_a_distribution_and_mostly_right():
    rows = soak.soak(2 * soak.PIECE, seed=0)
    assert len(rows) == 2
    assert not soak.failures(rows, whole=False)
    assert min(row.right for row in rows) > 0.8
    assert max(row.hypotheses for row in rows) < 10


def test_memory_and_time_that_grow_are_told():
    rows = [soak.Row(i / 6, 100 + i, 1 + i, 2.0, 0.0, 1.0, 1.0, 0.0) for i in range(24)]
    memory, time = soak.failures(rows, whole=True)
    assert memory == "memory grew by 12.0 MiB"
    assert time.startswith("steps take 2.")
    rows[3].sum_error = np.nan
    assert len(soak.failures(rows, whole=True)) == 3
