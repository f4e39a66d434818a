"""Runs of a bench, one after the other or some at a time."""

from collections.abc import Callable, Iterator
from typing import Any

from odm.processes import in_processes


def play_all(
    play: Callable[[Any], dict], jobs: list, processes: int, tell: Callable[[str], None]
) -> list[dict]:
    """Play all jobs, and tell how many are done.

    Args:
        play: A function of a module, called with a job.
        jobs: What it is called with.
        processes: Jobs at a time, each in a process of its own; 1: in this one.
        tell: Called with what is done.
    """
    played = []
    for one in _in_turn(play, jobs, min(processes, len(jobs))):
        played.append(one)
        tell(f"{len(played)} of {len(jobs)} runs done")
    return played


def _in_turn(play: Callable, jobs: list, processes: int) -> Iterator[dict]:
    if processes <= 1:
        yield from map(play, jobs)
        return
    with in_processes(processes, play, jobs) as played:
        yield from played
