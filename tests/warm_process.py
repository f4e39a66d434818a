"""Python processes that are forked from one which has imported this project already.

A process that imports it computes for a second before its own first line, and reads a
robot's loops for two more. `WarmPopen` starts `python -c CODE ...` or `python -m MODULE
...` without that, else as `subprocess.Popen` does. What a test asks of the start, or of
a memory that nobody has used, needs a process from its first line on.
"""

import atexit
import ctypes
import fcntl
import gc
import importlib
import json
import multiprocessing.process
import os
import runpy
import signal
import socket
import subprocess
import sys
import termios
import types
from contextlib import contextmanager
from functools import cache

HEARD = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_SUBREAPER = 36  # of prctl


class WarmPopen(subprocess.Popen):
    """A process in a session, and at a terminal if that is its input, of its own.

    Of the arguments of `Popen` it takes those that name the program, its folder, its
    environment and its three streams; `ignored`: it begins with signals ignored.
    `exercised`: all loops of a frame have been called, `odm run` does not call them
    once more, and its rehearsals are brief.
    `modules`: names of some that are imported, too.
    """

    def __init__(self, words, *, exercised=False, ignored=False, modules=(), **given):
        self._asked = {"words": list(map(str, words)), "exercised": exercised}
        self._asked |= {"ignored": ignored, "modules": modules}
        super().__init__([sys.executable, *self._asked["words"]], **given)

    def _execute_child(
        self, args, executable, preexec_fn, close_fds, pass_fds, cwd, env, *rest
    ):
        *_, p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite = rest[:9]
        theirs = [
            own if end == -1 else end
            for own, end in enumerate((p2cread, c2pwrite, errwrite))
        ]
        asked = self._asked | {"cwd": str(cwd or os.getcwd()), "env": dict(env)}
        self.pid = _fork(asked, theirs)
        self._child_created = True
        self._close_pipe_fds(p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite)


def _fork(asked, streams):
    """Return the pid of a new child of this process."""
    server = _server()
    with _taking_orphans():
        data = json.dumps(asked).encode()
        socket.send_fds(server, [len(data).to_bytes(4, "big")], streams)
        server.sendall(data)
        told = server.recv(4)
    assert len(told) == 4, "the process that others are forked from has ended"
    return int.from_bytes(told, "big")


@contextmanager
def _taking_orphans():
    """Become the parent of what loses its own; only for now: others go to init."""
    prctl = ctypes.CDLL(None, use_errno=True).prctl
    assert prctl(_SUBREAPER, 1, 0, 0, 0) == 0
    try:
        yield
    finally:
        prctl(_SUBREAPER, 0, 0, 0, 0)


@cache
def _server():
    """Start the process that others are forked from; it ends with this one."""
    ours, theirs = socket.socketpair()
    process = subprocess.Popen(
        [sys.executable, __file__, str(theirs.fileno())],
        pass_fds=[theirs.fileno()],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )
    theirs.close()

    @atexit.register
    def end():
        ours.close()
        process.wait()

    return ours


def serve(line):
    """Fork a process for each that is asked for; return in these alone what it is."""
    while True:
        size, streams, *_ = socket.recv_fds(line, 4, 3)
        if len(size) < 4:
            os._exit(0)  # who asked has ended
        data = b""
        while len(data) < int.from_bytes(size, "big"):
            data += line.recv(65536)
        asked = json.loads(data)
        for name in asked["modules"]:
            importlib.import_module(name)
        if asked["exercised"]:
            exercise_all()
        gc.freeze()  # else each of them looks through it all at its end
        ours, theirs = os.pipe()
        first = os.fork()
        if first == 0:
            second = os.fork()  # once the first has ended it is a child of who asked
            if second == 0:
                line.detach()
                become(asked, streams)
                return asked["words"]
            os.write(theirs, second.to_bytes(4, "big"))
            os._exit(0)
        os.waitpid(first, 0)
        line.sendall(os.read(ours, 4))
        for end in (ours, theirs, *streams):
            os.close(end)


@cache
def exercise_all():
    """Call all loops of a frame."""
    import tempfile
    from pathlib import Path

    from odm import build_map
    from sim.loop import warmup
    from sim.run import places

    places.REHEARSAL_S, places.exercise = 0.2, lambda cell_map: None  # as in conftest
    with tempfile.TemporaryDirectory() as folder:
        recipe = warmup.tiny_recipe(Path(folder))
        warmup.exercise(build_map(recipe, threads=1))


def become(asked, streams):
    """Take the folder, the environment, the streams and a session of its own."""
    os.setsid()
    for own, end in enumerate(streams):
        os.dup2(end, own)
    os.closerange(3, 64)
    if os.isatty(0):
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    for number in HEARD:
        signal.signal(number, signal.SIG_IGN if asked["ignored"] else signal.SIG_DFL)
    if not asked["ignored"]:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    os.chdir(asked["cwd"])
    multiprocessing.process.ORIGINAL_DIR = asked["cwd"]  # for processes of its own
    os.environ.clear()
    os.environ.update(asked["env"])
    sys.stdin = sys.__stdin__ = open(0, closefd=False)
    sys.stdout = sys.__stdout__ = open(
        1, "w", buffering=1 if os.isatty(1) else -1, closefd=False
    )
    sys.stderr = sys.__stderr__ = open(
        2, "w", buffering=1, errors="backslashreplace", closefd=False
    )


def be(words):
    """Run `-c CODE ...` or `-m MODULE ...` as the interpreter would."""
    how, what, *rest = words
    main = sys.modules["__main__"] = types.ModuleType("__main__")
    sys.path[0] = ""
    if how == "-c":
        sys.argv = ["-c", *rest]
        exec(compile(what, "<string>", "exec"), main.__dict__)
    else:
        assert how == "-m"
        sys.argv = [what, *rest]
        sys.modules.pop(f"{what}.__main__", None)  # it is run once, as the program
        if not hasattr(sys.modules.get(what), "__path__"):
            sys.modules.pop(what, None)
        runpy.run_module(what, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    from sim.__main__ import compute_alike

    compute_alike()
    import sim.keyboard.session
    import sim.record
    import sim.run.meet
    import sim.run.runner  # noqa: F401

    be(serve(socket.socket(fileno=int(sys.argv[1]))))
