"""Arrays that go to compiled kernels: a batch is one of as many as the reference, or one for all."""

import numpy as np
import pytest

from onboard.filters import FilterError
from onboard.filters.kernels.calls import check_like


@pytest.mark.parametrize("shape", [(2, 3), (5, 2, 3)])
def test_an_array_has_the_batch_of_its_reference_or_none(shape: tuple[int, ...]) -> None:
    check_like(np.zeros((5, 2, 3)), R=np.zeros(shape))


@pytest.mark.parametrize("shape", [(1, 2, 3), (4, 2, 3), (5, 5, 2, 3), (3, 2), (5, 3, 2)])
def test_an_array_of_another_batch_is_refused_by_name(shape: tuple[int, ...]) -> None:
    with pytest.raises(FilterError, match=r"^shapes do not fit: R \("):
        check_like(np.zeros((5, 2, 3)), R=np.zeros(shape))
