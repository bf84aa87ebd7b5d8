"""Estimators of the same leader that fly beside each other: each is scored by itself, and one is judged."""

from collections.abc import Iterable
from typing import Final

from onboard.messages import Estimate
from onboard.scoring.leader import LeaderScore, LeaderScorer
from onboard.scoring.reference import Reference

JUDGED: Final = "leader"  # the estimator whose score is the flight's; others fly beside it


def judged(names: Iterable[str]) -> str:
    """Which of the estimators that flew is judged: `leader`, or else the first of them."""
    flown = list(names)
    return JUDGED if JUDGED in flown or not flown else flown[0]


class LeaderScorers:
    """The scores of estimates that come one by one, in order, of any estimators: see `LeaderScorer`."""

    def __init__(self, reference: Reference | None) -> None:
        self._reference = reference
        self._scorers: dict[str, LeaderScorer] = {}

    def add(self, estimate: Estimate) -> None:
        """The next estimate. One of many targets, as traffic is, is not scored."""
        if estimate.is_primary:
            self._scorers.setdefault(estimate.name, LeaderScorer(self._reference)).add(estimate)

    def scores(self, end: float) -> tuple[LeaderScore, dict[str, LeaderScore]]:
        """The judged estimator's score until the flight's `end`, s, and those of others by their names."""
        scores = {name: scorer.score(end) for name, scorer in self._scorers.items()}
        score = scores.pop(judged(scores), None)
        return score or LeaderScorer(self._reference).score(end), scores
