"""Jobs done in processes of their own, which end with us, whatever ends us.

A pool of `multiprocessing` leaves semaphores behind where Ctrl-C ends a command, and
says so; and a process of it that outlives us complains that nobody listens. Here each
process sends its results through a pipe of its own, and nothing is shared.
"""

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any

from roadmap.errors import PlanningError


def _nothing() -> None:
    """Prepare nothing."""


@contextmanager
def ignoring_interrupts() -> Iterator[None]:
    """Start processes in here that hear no Ctrl-C, from their first line on.

    One that does complains of it, in the middle of an import. Who starts them has to
    end them.
    """
    resource_tracker.ensure_running()  # starting it would let them hear it again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def in_processes(
    number: int,
    run: Callable[[Any], Any],
    jobs: list,
    prepare: Callable[..., None] = _nothing,
    given: tuple = (),
) -> Iterator[Iterator[Any]]:
    """Yield an iterator of what each job returns, in their order.

    Job k is done by process k modulo `number`, each of which calls `prepare(*given)`
    first; they begin at once. `run` and `prepare` are functions of a module. What a job
    raises is raised here. No process is left afterwards.

    Raises:
        PlanningError: A process was ended from outside (from the iterator).
    """
    context = multiprocessing.get_context("spawn")
    ends, children = [], []
    try:
        for k in range(number):
            here, there = context.Pipe(duplex=False)
            work = (there, run, jobs[k::number], prepare, given)
            children.append(context.Process(target=_work, args=work, daemon=True))
            ends.append(here)
            with ignoring_interrupts():
                children[-1].start()
            there.close()
        yield (_result(ends[k % number]) for k in range(len(jobs)))
    finally:
        for child in children:
            if child.pid is not None:
                child.kill()
                child.join()


def _result(end: Connection) -> Any:
    try:
        failed, result = end.recv()
    except EOFError as error:
        raise PlanningError(
            "a process ended before its work was done: it was killed, or there is not "
            "enough memory; close other programs, or take fewer processes"
        ) from error
    if failed:
        raise result
    return result


def _work(
    end: Connection, run: Callable, jobs: list, prepare: Callable, given: tuple
) -> None:
    """Do jobs in a process of its own, until they are done or nobody listens."""
    with suppress(BrokenPipeError):
        try:
            prepare(*given)
            for job in jobs:
                end.send((False, run(job)))
        except Exception as error:
            end.send((True, error))
