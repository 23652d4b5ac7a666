from experiments.determinism import differing, timeless

TABLE = b"references aligned,correct,mean_ms,maximum_ms\n5,31,%s,%s\n"


def test_only_measured_times_are_left_out():
    first, second = (
        timeless("demo", "table.csv", TABLE % times) for times in ((b"1", b"2"), (b"3", b"4"))
    )
    assert first == second == b"references aligned,correct\n5,31"
    printed = (
        b"| correct |  31 |\n| mean time | 8.6 ms |",
        b"| correct | 31 |\n| mean time | 9 ms |",
    )
    assert {timeless("demo", "standard output", each) for each in printed} == {b"| correct | 31 |"}
    assert timeless("sweep", "times.csv", b"piece,seconds\n") == b""
    assert timeless("sweep", "sweep.csv", b"hits\n0.5\n") == b"hits\n0.5\n"


def test_a_file_of_one_run_alone_differs_too():
    assert differing({"a": b"1", "b": b"2"}, {"a": b"1", "c": b"2"}) == ["b", "c"]
