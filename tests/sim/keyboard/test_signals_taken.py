"""Ctrl-C that the keyboard's screen took does not end the process behind its back."""

import pytest
from command_line import started

_CODE = """
import os, signal, time
from sim.keyboard.signals import Signals
from sim.terminal import interrupt

# as in a shell with somebody at it, whatever shell the tests run in
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGTERM, signal.SIG_DFL)
plain_read = os.read

def late(*given):  # a thread that wakes late, as on a busy machine
    heard = plain_read(*given)
    time.sleep(0.3)
    return heard

os.read = late
interrupt.GRACE = 0.2
with interrupt.interruptible():
    interrupt._listener.grace = 0.2
    for _ in range({taken}):
        with Signals() as signals:
            signal.raise_signal(signal.{name})
        assert signals.ended == "{name}"
    time.sleep(1.2)
    print("its figures are written", flush=True)
    if {again}:
        try:
            signal.raise_signal(signal.{name})
        except KeyboardInterrupt:
            time.sleep(5.0)
"""


@pytest.mark.parametrize(
    ("taken", "again", "name", "code"),
    [(1, False, "SIGINT", 0), (2, True, "SIGINT", 130), (1, True, "SIGTERM", 143)],
)
def test_who_took_it_goes_on_and_the_next_one_ends_the_process(
    taken, again, name, code, tmp_path
):
    words = ["-c", _CODE.format(taken=taken, again=again, name=name)]
    with started(words, tmp_path, warm={}) as process:
        out, err = process.communicate(timeout=60)
    assert "its figures are written" in out, err
    assert process.returncode == code
