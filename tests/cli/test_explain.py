from pathlib import Path

import pytest

import aprjax.cli.explain as cli_explain


@pytest.fixture
def asked(monkeypatch):
    """What the command asks to be explained, without the work."""
    calls = []

    def explain(scan, references, config, **options):
        calls.append((scan, references, config, options))
        return "<p>page</p>"

    monkeypatch.setattr(cli_explain, "explain", explain)
    return calls


def test_one_scan_of_the_log_is_explained_and_the_page_written(logs, tmp_path, command, asked):
    out = tmp_path / "page.html"
    words = ("--query", 3, "--about", 7, "--about", 1, "--exclude-self", "--top-k", 5)
    status, printed, err = command("explain", *logs, "--out", out, *words)
    assert (status, printed, err) == (0, "", "")
    assert out.read_text() == "<p>page</p>"
    ((scan, references, config, options),) = asked
    assert scan.ranges.shape == (181,)
    assert len(references) == 8
    assert config.top_k == 5
    assert config.cascade
    assert options["exclude"] == [3]
    assert options["about"] == [7, 1]
    assert options["title"] == "queries.log.gz, scan 3, in references.log.gz"


@pytest.mark.parametrize("number", [20, -1])
def test_a_scan_that_is_not_there_is_one_clear_line(logs, tmp_path, command, asked, number):
    out = tmp_path / "page.html"
    status, _, err = command("explain", *logs, f"--query={number}", "--out", out)
    assert (status, asked) == (1, [])
    assert err == f"aprjax: {logs[1]}: there is no scan {number}, only 0 to 19\n"
    assert not out.exists()


@pytest.mark.usefixtures("asked")
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_one_line(logs, command):
    status, _, err = command("explain", *logs, "--query", 3, "--out", "/dev/full")
    assert (status, err) == (1, "aprjax: /dev/full: No space left on device\n")
