from aprjax.tracking.replay import matched, replay
from tests.tracking.worlds import corridor, tracker


def test_of_no_scans_nothing_is_believed():
    assert list(replay(tracker(), [])) == []
    assert list(matched(corridor(), [])) == []
