"""Filters in threads: a linear record lets others run meanwhile, and all give the bits that they give alone."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from onboard.filters import Belief, LinearModel, Model, methods, run
from onboard.filters.kernels import records
from onboard.filters.runs import Run
from tests.support import kernels

THREADS = 4
NAMES = ("kalman", "extended", "square-root", "csvsf", "augmented", "imm")


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


def test_records_in_threads_are_those_of_one_thread_to_the_bit_seeds_0_to_7() -> None:
    F, Q, R = np.array([[1.0, 0.1], [0.0, 1.0]]), 0.01 * np.eye(2), 0.1 * np.eye(2)
    linear = LinearModel(F, Q, np.eye(2), R)
    model = Model(lambda rows: rows @ F.T, Q, lambda rows: rows * 1.0, R)
    starts = Belief(np.zeros((20, 2)), np.tile(np.eye(2), (20, 1, 1)))
    all_ = methods()

    def record(job: tuple[str, int]) -> Run:
        name, seed = job
        ys = np.random.default_rng(seed).normal(size=(50, 20, 2))
        return run(all_[name], linear if name == "kalman" else model, starts, ys)

    jobs = [(name, seed) for seed in range(8) for name in NAMES]
    alone = [record(job) for job in jobs]
    with ThreadPoolExecutor(THREADS) as pool:
        together = list(pool.map(record, jobs))
    for one, other in zip(alone, together, strict=True):
        for a, b in zip((*one.beliefs, one.log_likelihood), (*other.beliefs, other.log_likelihood), strict=True):
            np.testing.assert_array_equal(a, b)
