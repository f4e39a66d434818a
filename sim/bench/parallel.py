"""Runs of a bench in processes of their own, several at a time."""

import multiprocessing
from collections.abc import Callable, Sequence


def run_jobs(
    function: Callable[[tuple], dict],
    jobs: Sequence[tuple],
    processes: int,
    tell: Callable[[str], None],
) -> list[dict]:
    """Return what a function of a module returns for each job, in order.

    Args:
        function: Of one job.
        jobs: Plain data.
        processes: At a time; 1: this one does it all.
        tell: Called with how many are done.
    """
    if processes <= 1:
        return [function(job) for job in jobs]
    done = []
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for one in pool.imap(function, jobs, chunksize=1):
            done.append(one)
            if len(done) < len(jobs):
                tell(f"{len(done)} of {len(jobs)} runs done")
    return done
