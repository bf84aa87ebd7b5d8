"""What STATUSTEXT tells the pilot, and how often."""

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from onboard.autopilot.notices import Notices, Rank
from onboard.messages import Advice, Lifecycle, Severity
from tests.support.leader import S, estimate

Add = Callable[[Notices, int], None]


def texts(notices: Notices, seconds: float) -> list[tuple[float, str]]:
    """(s, text) of what is sent, looked for every 20 ms."""
    sent = []
    for k in range(round(seconds * 50)):
        sent += [(k / 50, text.text) for text in notices.due(1000 * S + k * S // 50)]
    return sent


def test_changes_of_the_leader_are_told_once() -> None:
    notices = Notices()
    for valid, state in ((False, Lifecycle.SEARCHING), (True, Lifecycle.TRACKING), (True, Lifecycle.COASTING)):
        notices.report_leader(estimate(valid=valid, state=state))
    (tracked,) = notices.due(1000 * S)
    assert (tracked.text, tracked.severity) == ("leader tracked", 6)
    assert texts(notices, 3) == []
    notices.report_leader(estimate(valid=False, state=Lifecycle.LOST))
    notices.report_leader(estimate(valid=False, state=Lifecycle.LOST))
    (lost,) = notices.due(1005 * S)
    assert (lost.text, lost.severity) == ("leader lost", 4)
    notices.report_leader(estimate(name="traffic", valid=True))
    notices.report_leader(estimate(target="target/1", valid=True))
    assert notices.due(1010 * S) == []


def test_one_text_a_second_and_the_same_one_every_ten() -> None:
    notices = Notices()
    for k in range(8):
        notices.add(4, "abcdefgh"[k] * 210)
    newest = [(float(k), f"{'defgh'[k] * 197}...") for k in range(5)]  # five, cut to fit
    assert texts(notices, 9) == newest
    notices = Notices()
    notices.add(4, "again")
    assert len(texts(notices, 2)) == 1
    notices.add(4, "again")
    assert notices.due(1008 * S) == []
    notices.add(4, "again")
    assert len(notices.due(1011 * S)) == 1


def advise(notices: Notices, k: int) -> None:
    about = f"camera {chr(97 + k % 26)}"
    text = f"{about}: refused"
    notices.advise(Advice(cause="c", severity=Severity.ERROR, about=about, what=text, remedy="", text=text))


@pytest.mark.parametrize(
    "add",
    [
        lambda notices, k: notices.add(4, f"refused: LDR_SIZE_M = {k}: expected 0.02 to 200"),
        lambda notices, k: notices.add(4, f"refused: {chr(97 + k % 26)}", Rank.OTHERS, "system 66, component 1"),
        lambda notices, k: notices.add(4, f"refused: {k}", Rank.OTHERS, f"system {k % 250}, component 1"),
        advise,
    ],
    ids=["one value after the other", "one parameter after the other", "many senders", "advice about others"],
)
@pytest.mark.parametrize("state", ["lost", "rebooted"])
def test_the_words_of_others_never_push_out_what_concerns_our_own_state(add: Add, state: str) -> None:
    """At 1 to 50 a second, before and after what the pilot must know."""
    for every in (50, 10, 1):
        notices, sent, at = (
            Notices(),
            list[tuple[float, str]](),
            505,
        )  # just after a text
        notices.report_leader(estimate(valid=True))
        for k in range(1000):
            if k % every == 0:
                add(notices, k // every)
            if k == at and state == "lost":
                notices.report_leader(estimate(valid=False, state=Lifecycle.LOST))
            elif k == at:
                notices.add(4, "the autopilot has rebooted")
            sent += [(k / 50, text.text) for text in notices.due(k * S // 50)]
        words = "leader lost" if state == "lost" else "the autopilot has rebooted"
        (when,) = [t for t, text in sent if text == words]
        assert at / 50 <= when <= at / 50 + 2.0
        assert len(sent) <= 20


def test_a_sender_gets_one_line_in_ten_seconds_and_another_sender_one_of_its_own() -> None:
    notices, sent = Notices(), list[str]()
    for k in range(1000):
        notices.add(4, f"refused: {chr(97 + k % 26)}", Rank.OTHERS, "a")
        if k == 100:
            notices.add(4, "refused: of b", Rank.OTHERS, "b")
        sent += [text.text for text in notices.due(k * S // 50)]
    assert len(sent) == 3
    assert sent.count("refused: of b") == 1


def test_what_concerns_our_own_state_goes_first() -> None:
    notices = Notices()
    for k in range(5):
        advise(notices, k)
        notices.add(4, "refused", Rank.OTHERS, f"system {k}")
    notices.add(4, "the autopilot has rebooted")
    notices.report_leader(estimate(valid=True))
    sent = [text.text for k in range(20) for text in notices.due(k * S)]
    assert sent[:2] == ["leader tracked", "the autopilot has rebooted"]
    assert len(sent) == 12


def test_of_advice_of_one_cause_about_one_thing_the_newest_words_wait() -> None:
    """Its words alone do not make it another."""
    notices = Notices()
    one = Advice(kind="noise", severity=Severity.WARNING, about="camera a", what="", remedy="", text="2.1 times")
    for change in ({}, {"text": "noisier by far"}, {"about": "camera b", "text": "of b"}, {"kind": "lens"}):
        notices.advise(replace(one, **change))
    assert [text for _, text in texts(notices, 6)] == ["noisier by far", "of b", "2.1 times"]
