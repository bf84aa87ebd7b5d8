"""Flights with a common beginning, which is flown once.

Each flight continues with a copy of the pipeline.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Final, Generic, NamedTuple, TypeVar

from onboard.messages import Output
from onboard.pipeline import Pipeline
from tests.support.streams import Run, make_config

COPY_PERIOD: Final = 25  # messages between two copies of the shared flight
T = TypeVar("T")


class Copy(NamedTuple):
    """A pipeline after a number of messages, with its count of outputs."""

    taken: int
    pipeline: Pipeline
    made: int


class Beginning(Generic[T]):
    """A flight from which others depart, with the defaults.

    `step`: what a pipeline makes of one message.
    """

    def __init__(self, sent: Sequence[T], step: Callable[[Pipeline, T], list[Output]]) -> None:
        self._sent, self._step = sent, step
        self._copies: list[Copy] = []
        self._outputs: list[Output] = []

    def run(self, sent: Sequence[T]) -> Run:
        """Run these messages, from the last copy before they differ from the shared flight's."""
        if not self._copies:
            self._fly()
        pairs = enumerate(zip(sent, self._sent, strict=False))
        same = next((k for k, (a, b) in pairs if a != b), min(len(sent), len(self._sent)))
        last = next(copy for copy in reversed(self._copies) if copy.taken <= same)
        pipeline, outputs = deepcopy(last.pipeline), self._outputs[: last.made]
        for one in sent[last.taken :]:
            outputs.extend(self._step(pipeline, one))
        return Run(pipeline, outputs)

    def _fly(self) -> None:
        pipeline = Pipeline(make_config())
        for k, one in enumerate(self._sent):
            if k % COPY_PERIOD == 0:
                self._copies.append(Copy(k, deepcopy(pipeline), len(self._outputs)))
            self._outputs.extend(self._step(pipeline, one))
        self._copies.append(Copy(len(self._sent), pipeline, len(self._outputs)))
