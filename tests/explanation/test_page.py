import base64
import re
from html.parser import HTMLParser

import jax
import numpy as np
import pytest

import aprjax
from aprjax.explanation.page import page
from aprjax.explanation.stages import Stage, _trace, account
from aprjax.matcher import MatchConfig
from aprjax.references import ReferenceSet
from aprjax.scan import Scan
from tests.worlds import free_pose, office, scan_at

CONFIG = MatchConfig()
EXCLUDED = 5


@pytest.fixture(scope="module")
def references():
    """Eight references of an office, all but the last at known places."""
    rng = np.random.default_rng(7)
    world = office(seed=3)
    poses = np.array([free_pose(world, rng) for _ in range(8)])
    known = np.where(np.arange(8)[:, None] < 7, poses, np.nan)
    scans = [scan_at(world, pose, noise=0.01, rng=rng) for pose in poses]
    return ReferenceSet.build(scans, T_world_ref=known)


@pytest.fixture(scope="module")
def scan(references):
    """A scan from where reference 2 was taken, but turned by 0.3 rad."""
    pose = references.T_world_ref[2] + np.array([0.0, 0.0, 0.3])
    return scan_at(office(seed=3), pose, noise=0.01, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def told(scan, references):
    return account(scan, references, CONFIG, exclude=[EXCLUDED])


@pytest.fixture(scope="module")
def text(told, scan, references):
    return page(told, scan, references, CONFIG, [EXCLUDED], "<script>a & b</script>")


class Reader(HTMLParser):
    """Pictures, rows of tables, and tags that do not match."""

    def __init__(self, text):
        super().__init__()
        self.open, self.wrong, self.pictures, self.rows = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.pictures.append(dict(attrs))
        elif tag != "meta":
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])

    def handle_endtag(self, tag):
        if self.open.pop() != tag:
            self.wrong.append(tag)

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1].append(data)


def test_the_stages_leave_what_the_matcher_says_it_left(told):
    counts = told.result.counts
    assert sum(fate.aligned for fate in told.fates) == counts.alternatives
    assert sum(fate.aligned > 0 for fate in told.fates) == counts.aligned
    assert sum(fate.kept for fate in told.fates) == counts.evaluated
    for fate in told.fates:
        assert fate.aligned >= fate.passed >= fate.kept


def test_hypotheses_have_the_e_m_that_rivals_then_lower(told):
    valid = told.result.valid
    assert valid[0]
    assert told.result.reference[0] == 2
    np.testing.assert_array_less(told.result.quality[valid] - 1e-6, told.e_m[valid])
    assert told.rivalry[0] == 0
    best = max(fate.e_m for fate in told.fates)
    assert told.e_m[0] == pytest.approx(best)


def test_every_reference_has_one_fate_the_farthest_first(told, references):
    assert sorted(fate.reference for fate in told.fates) == references.ids.tolist()
    stages = [fate.stage for fate in told.fates]
    assert stages == sorted(stages, reverse=True)
    answered = {fate.reference for fate in told.fates if fate.stage == Stage.ANSWERED}
    assert answered == set(told.result.reference[told.result.valid].tolist())
    assert {f.reference for f in told.fates if f.stage == Stage.NOT_COMPARED} == {EXCLUDED}
    for fate in told.fates:
        assert (fate.T_ref_query is None) == (fate.aligned == 0)


def test_the_page_is_one_piece_of_well_formed_html(text):
    read = Reader(text)
    assert (read.open, read.wrong) == ([], [])
    assert len(read.pictures) >= 6
    for picture in read.pictures:
        kind, data = picture["src"].split(",", 1)
        assert kind == "data:image/png;base64"
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG")
        assert picture["alt"]
    without_pictures = re.sub(r'src="data:[^"]*"', "", text)
    assert not re.search(r"https?:|src=|href=|url\(|<script", without_pictures)
    assert "<h1>&lt;script&gt;a &amp; b&lt;/script&gt;</h1>" in text


def test_the_table_has_a_row_for_each_hypothesis(told, text):
    read, result = Reader(text), told.result
    rows = [row for row in read.rows if len(row) in (11, 12)]
    for k in np.flatnonzero(result.valid):
        row = next(row for row in rows if row[0] == str(k))
        assert row[1] == str(result.reference[k])
        assert row[5] == f"{result.preselection[k]:.2f}"
        assert row[6:8] == [str(result.agreeing_anchors[k]), str(result.agreeing_beams[k])]
        assert f"{result.quality[k]:.3f}" in row
        assert f"{result.probability[k]:.3f}" in row


def test_a_reference_that_was_asked_about_is_told_of_first(text):
    after = text[text.index("Why not another reference") :]
    rows = Reader(after[after.index("<table") : after.index("</table>") + 8]).rows
    assert rows[1][0] == str(EXCLUDED)
    assert rows[1][-1].startswith("not compared")


def test_a_scan_without_anything_has_a_page_that_says_so(references):
    nothing = Scan.make(np.full(181, np.nan), angle_min=-1.5, angle_increment=0.017, range_max=9.0)
    text = aprjax.explain(nothing, references, about=[1])
    assert "too_few_anchors" in text
    assert "Hypotheses, best first" not in text
    assert Reader(text).wrong == []


def test_a_reference_that_is_none_cannot_be_asked_about(scan, references):
    with pytest.raises(ValueError, match=r"about\[1\]: no reference has id 8"):
        aprjax.explain(scan, references, about=[0, 8])


def test_without_the_cascade_its_two_looks_leave_all_there_is(told, references):
    shapes = jax.eval_shape(
        _trace, told.query, np.array([-1]), references.index, MatchConfig(cascade=False)
    )
    assert shapes.aligned.row.shape == shapes.kept.row.shape == shapes.evaluated.row.shape


def test_there_is_room_for_all_hypotheses_that_are_asked_for(told, references):
    shapes = jax.eval_shape(
        _trace, told.query, np.array([-1]), references.index, MatchConfig(hypotheses=120)
    )
    assert shapes.passed.row.shape == shapes.kept.row.shape == (120,)


def test_where_a_process_allows_64_bits_the_page_is_the_same(text, scan, references, wide):
    wide()
    told = account(scan, references, CONFIG, exclude=[EXCLUDED])
    again = page(told, scan, references, CONFIG, [EXCLUDED], "<script>a & b</script>")
    assert again == text
