"""What STATUSTEXT tells the pilot, and how often."""

from onboard.autopilot.notices import Notices
from onboard.messages import Lifecycle
from tests.support.leader import S, estimate


def texts(notices: Notices, seconds: float) -> list[tuple[float, str]]:
    """(s, text) of what is sent, looked for every 20 ms."""
    sent = []
    for k in range(round(seconds * 50)):
        sent += [(k / 50, text.text) for text in notices.due(1000 * S + k * S // 50)]
    return sent


def test_changes_of_the_leader_are_told_once() -> None:
    notices = Notices()
    for valid, state in ((False, Lifecycle.SEARCHING), (True, Lifecycle.TRACKING), (True, Lifecycle.COASTING)):
        notices.note(estimate(valid=valid, state=state))
    (tracked,) = notices.due(1000 * S)
    assert (tracked.text, tracked.severity) == ("leader tracked", 6)
    assert texts(notices, 3) == []
    notices.note(estimate(valid=False, state=Lifecycle.LOST))
    notices.note(estimate(valid=False, state=Lifecycle.LOST))
    (lost,) = notices.due(1005 * S)
    assert (lost.text, lost.severity) == ("leader lost", 4)
    notices.note(estimate(name="traffic", valid=True))
    notices.note(estimate(target="target/1", valid=True))
    assert notices.due(1010 * S) == []


def test_one_text_a_second_and_the_same_one_every_ten() -> None:
    notices = Notices()
    for k in range(8):
        notices.add(4, f"{k}" * 210)
    assert texts(notices, 9) == [(float(k), f"{k + 3}" * 200) for k in range(5)]  # the newest five, cut to fit
    notices = Notices()
    notices.add(4, "again")
    assert len(texts(notices, 2)) == 1
    notices.add(4, "again")
    assert notices.due(1008 * S) == []
    notices.add(4, "again")
    assert len(notices.due(1011 * S)) == 1
