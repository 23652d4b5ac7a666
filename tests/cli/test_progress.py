import io

import aprjax.cli.progress
from aprjax.cli.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_a_bar():
    stream = Terminal()
    with Progress("matching", 4, stream) as progress:
        progress.advance(1)
        progress.advance(3)
    frames = stream.getvalue().rstrip("\n").split("\r")[1:]
    assert [frame.count("#") for frame in frames] == [0, 7, 30]
    assert "4 of 4" in frames[-1]
    assert stream.getvalue().endswith("\n")


def test_elsewhere_a_line_now_and_then(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(aprjax.cli.progress.time, "monotonic", lambda: clock[0])
    stream = io.StringIO()
    with Progress("matching", 40, stream) as progress:
        for _ in range(40):
            clock[0] += 1.0
            progress.advance(1)
    assert stream.getvalue().splitlines() == [
        "matching: 10 of 40, 10 s",
        "matching: 20 of 40, 20 s",
        "matching: 30 of 40, 30 s",
    ]


def test_short_work_is_silent():
    stream = io.StringIO()
    with Progress("matching", 2, stream) as progress:
        progress.advance(2)
    assert stream.getvalue() == ""
