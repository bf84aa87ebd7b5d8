"""Causes beside reasons: in what is published, and in what was recorded before there were any."""

import re
from typing import Any

import msgspec
import pytest

from onboard.messages import (
    Cause,
    Estimate,
    Health,
    LeaderState,
    LinkHealth,
    NavState,
    Reason,
    Record,
    Refusal,
    SinkHealth,
    invalidate,
)
from onboard.messages.schemas import describe, schemas
from tests.support.leader import leader_state
from tests.support.records import make_estimate
from tests.support.streams import feed
from tests.support.vehicle_records import nav_state

REFUSAL = Refusal(source="camera front", reason="no", count=1, t_recv_ns=1, cause=Cause.TOO_OLD)
HEALTH = msgspec.structs.replace(
    feed([]).pipeline.health(1), refusals=(REFUSAL,), links={"a": LinkHealth()}, sinks={"b": SinkHealth()}
)
OLD = Reason(Cause.OUTDATED, "published too long ago")


def without_causes(tree: Any) -> Any:
    """A record as it was written before there were causes."""
    if isinstance(tree, dict):
        kept = {k: v for k, v in tree.items() if k not in ("causes", "beside_ids")}
        return {k: without_causes(v) for k, v in kept.items() if k != "cause" or "severity" in tree}
    return [without_causes(one) for one in tree] if isinstance(tree, list) else tree


@pytest.mark.parametrize("record", [make_estimate(), nav_state(), leader_state(), REFUSAL, HEALTH], ids=type)
def test_a_record_from_before_there_were_causes_is_read(record: Record) -> None:
    data = msgspec.json.encode(without_causes(msgspec.json.decode(msgspec.json.encode(record))))
    assert b'"causes"' not in data
    old = msgspec.json.decode(data, type=type(record))
    assert getattr(old, "cause", Cause.NONE) is Cause.NONE
    if isinstance(old, Health):
        assert old.causes == {}
        assert old.refusals[0].cause is Cause.NONE


def test_each_cause_has_a_plain_name_and_is_listed_with_its_meaning() -> None:
    text, listed = describe(), schemas()
    for cause in Cause:
        assert re.fullmatch(r"[a-z]+(_[a-z]+)*", cause)
        assert f"| `{cause}` | {cause.meaning} |" in text
        for key in ("estimate/<name>", "own_state", "leader", "health"):
            assert cause in listed[key]["$defs"]["Cause"]["enum"]


def test_a_record_that_is_no_longer_valid_says_why_in_both_ways() -> None:
    for record in (make_estimate(), nav_state(), leader_state()):
        assert record.valid
        assert isinstance(record, Estimate | NavState | LeaderState)
        made = invalidate(record, OLD)
        assert (made.valid, made.cause, made.reason) == (False, *OLD)


def test_more_words_are_of_the_same_cause() -> None:
    assert OLD.also("and long") == (Cause.OUTDATED, "published too long ago; and long")
