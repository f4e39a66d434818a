"""Jobs done in processes of their own, which end with us, whatever ends us.

A pool of `multiprocessing` leaves semaphores behind where Ctrl-C ends a command, and
says so; and a process of it that outlives us complains that nobody listens. Here each
process sends its results through a pipe of its own, and nothing is shared.
"""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from roadmap.errors import PlanningError

_FINISHING_S = 0.3  # for a file that a process has begun; others end at once


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


def end_processes(processes: Iterable[BaseProcess]) -> None:
    """End processes, and wait until they are gone.

    SIGTERM ends one in the middle of the compiler, too, but not while it writes machine
    code down (see `roadmap.compiling.kept_code`), of which half a file would stay.
    """
    begun = [process for process in processes if process.pid is not None]
    for process in begun:
        process.terminate()
    latest = time.monotonic() + _FINISHING_S
    for process in begun:
        process.join(max(0.0, latest - time.monotonic()))
        process.kill()
        process.join()


def end_all() -> None:
    """End all that was begun by this process, which is itself ended next.

    Python's process beside, which notes what was begun, ends when nobody holds its
    pipe: a moment after us, if we did not wait for it.
    """
    end_processes(multiprocessing.active_children())
    latest = time.monotonic() + _FINISHING_S
    with suppress(ChildProcessError):  # nobody is left
        os.waitpid(-1, os.WNOHANG)
        os.close(resource_tracker.getfd())
        while time.monotonic() < latest:
            os.waitpid(-1, os.WNOHANG)
            time.sleep(0.002)


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
        end_processes(children)


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
