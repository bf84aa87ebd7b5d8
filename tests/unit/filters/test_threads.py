"""Filters in threads: a linear record lets others run meanwhile, and all give the bits that they give alone."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from onboard.filters.kernels import records
from tests.support import kernels


@pytest.mark.skipif(not kernels.are_compiled(), reason="WINGLINE_KERNELS: nothing is compiled")
def test_the_loop_over_a_record_lets_other_threads_run() -> None:
    """A thread counts on while another filters a record of a second."""
    count, steps = 0, 200_000
    F, R, one = np.eye(4)[None], np.eye(4)[None], np.ones((1, 4))
    record = one, F, F, F, 0.0 * one, F, R, np.ones((steps, 1, 4)), np.zeros(4, bool)
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(records.filter_record, *record)
        while not done.done():
            count += 1
    assert done.result()[-1] == 0
    assert count > 100
