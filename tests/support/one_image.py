"""One image of the leader through the default pipeline, with all calls of our functions."""

import sys
from functools import cache
from types import FrameType
from typing import Any, NamedTuple

from onboard.config import parse_config
from onboard.messages import Estimate, Verdict
from onboard.pipeline import Pipeline
from tests.support.programs import ROOT
from tests.support.streams import Stream

MAX_OTHER_BYTES = 100  # of a datagram without an image, which has three LANDING_TARGETs
INLINED = {"<listcomp>", "<setcomp>", "<dictcomp>", "<genexpr>", "<lambda>"}  # by later versions of Python
PACKAGE = f"{ROOT / 'onboard'}/"


class Way(NamedTuple):
    """The calls from `Pipeline.feed` with the image's bytes to its estimate."""

    estimate: Estimate
    deepest: tuple[tuple[str, str], ...]  # (file, function) of the deepest call stack
    files: frozenset[str]  # all that take part
    stays: int  # how often it enters or re-enters a file
    calls: int


@cache
def way_of_one_image() -> Way:
    """With the default settings of `[estimator.leader]`, in the steady state."""
    pipeline = Pipeline(parse_config({"estimator": {"leader": {}}}))
    datagrams = Stream(t0=5.0, t1=9.0, seed=1).datagrams()
    newest = max(k for k, d in enumerate(datagrams) if len(d.data) > MAX_OTHER_BYTES)
    for datagram in datagrams[:newest]:
        pipeline.feed(datagram)
    stack: list[tuple[str, str]] = []
    deepest: list[tuple[str, str]] = []
    files: set[str] = set()
    stays: list[str] = []
    calls = 0

    def enter(file: str) -> None:
        if stays[-1:] != [file]:
            stays.append(file)

    def on_event(frame: FrameType, event: str, _: Any) -> None:
        nonlocal calls
        file = frame.f_code.co_filename
        if not file.startswith(PACKAGE) or frame.f_code.co_name in INLINED:
            return
        if event == "call":
            if stack:
                enter(stack[-1][0])
            calls += 1
            stack.append((file.removeprefix(f"{ROOT}/"), frame.f_code.co_qualname))
            enter(stack[-1][0])
            files.add(stack[-1][0])
            if len(stack) > len(deepest):
                deepest[:] = stack
        elif event == "return":
            stack.pop()

    before = sys.getprofile()
    sys.setprofile(on_event)
    try:
        outputs = pipeline.feed(datagrams[newest])
    finally:
        sys.setprofile(before)
    (estimate,) = [o for o in outputs if isinstance(o, Estimate)]
    assert estimate.measurement is not None
    assert estimate.measurement.verdict is Verdict.FUSED
    return Way(estimate, tuple(deepest), frozenset(files), len(stays), calls)
