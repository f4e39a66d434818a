"""Runs of a bench in processes of their own, several at a time."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence


def run_jobs(
    function: Callable[[tuple], dict], jobs: Sequence[tuple], processes: int
) -> Iterator[dict]:
    """Yield what a function of a module returns for each job, in order.

    With one process it is this one.
    """
    if processes <= 1:
        yield from map(function, jobs)
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield from pool.imap(function, jobs, chunksize=1)
