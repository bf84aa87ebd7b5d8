"""Scores of several estimators of one leader in one flight; one of them is the flight's."""

from collections.abc import Iterable
from typing import Final

from onboard.messages import Estimate
from onboard.scoring.leader import LeaderScore, LeaderScorer
from onboard.scoring.reference import Reference

PRIMARY_ESTIMATOR: Final = "leader"  # the estimator that gives the flight's score


def judged(names: Iterable[str]) -> str:
    """Return the estimator whose score is the flight's: `leader`, otherwise the first."""
    flown = list(names)
    return PRIMARY_ESTIMATOR if PRIMARY_ESTIMATOR in flown or not flown else flown[0]


class LeaderScorers:
    """Scores of estimates from any estimators, added one by one in order; see `LeaderScorer`."""

    def __init__(self, reference: Reference | None) -> None:
        self._reference = reference
        self._scorers: dict[str, LeaderScorer] = {}

    def add(self, estimate: Estimate) -> None:
        """Add the next estimate. Estimators of many targets, such as traffic, are not scored."""
        if estimate.is_primary:
            self._scorers.setdefault(estimate.name, LeaderScorer(self._reference)).add(estimate)

    def scores(self, end: float) -> tuple[LeaderScore, dict[str, LeaderScore]]:
        """Return the flight's score until its `end`, s, and the other estimators' scores by name."""
        scores = {name: scorer.score(end) for name, scorer in self._scorers.items()}
        score = scores.pop(judged(scores), None)
        return score or LeaderScorer(self._reference).score(end), scores
