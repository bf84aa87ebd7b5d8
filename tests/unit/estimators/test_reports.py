"""What estimators publish of a belief is that belief, to the bit."""

import numpy as np

from onboard.estimators.kit.reports import belief_fields
from onboard.filters.belief import Belief


def test_the_published_mean_and_covariance_are_the_belief_s() -> None:
    belief = Belief(np.array([1.0, -2.0]), np.array([[0.3, 0.1], [0.1, 7.0]]))
    assert belief_fields(belief) == {"mean": (1.0, -2.0), "covariance": ((0.3, 0.1), (0.1, 7.0))}
    assert belief_fields(None) == {"mean": None, "covariance": None}
