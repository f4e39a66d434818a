"""A user at a terminal for tests: real key bytes in, the screen as it would be seen."""

import codecs
import contextlib
import fcntl
import os
import re
import select
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

from command_line import hear
from warm_process import WarmPopen

# A test has failed whose program computed for longer than this while it waited, or
# which waited for so many times as long: on a busy machine a program hardly gets on [s]
PATIENCE, IDLE = 60.0, 5.0
_PIECE = re.compile(r"\x1b\[([?\d;]*)([A-Za-z])|\x1b\[[?\d;]*$|\x1b$|[\r\n]|.", re.S)


def computed(pid):
    """Return for how long a process has computed, its ended children's time too [s]."""
    try:
        told = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:  # it has ended
        return 0.0
    return sum(map(int, told[11:15])) / os.sysconf("SC_CLK_TCK")


class SeenScreen:
    """The part of a terminal that the screen uses; everything else is an error."""

    def __init__(self, columns, lines):
        self.columns, self.lines = columns, lines
        self.modes = {"1049": False, "25": True, "7": True}
        self.scrolled, self._rest = 0, ""
        self._clear()

    def _clear(self):
        self.rows = [[" "] * self.columns for _ in range(self.lines)]
        self.row = self.column = 0

    def resize(self, columns, lines):
        """Keep what is there, as far as it fits."""
        old, (self.columns, self.lines) = self.rows, (columns, lines)
        self._clear()
        for new, was in zip(self.rows, old, strict=False):
            new[: min(columns, len(was))] = was[:columns]

    def feed(self, text):
        text, self._rest = self._rest + text, ""
        for piece in _PIECE.finditer(text):
            if piece.group(2):
                self._command(piece.group(1), piece.group(2))
            elif piece.group().startswith("\x1b"):
                self._rest = piece.group()
            else:
                self._put(piece.group())

    def _command(self, numbers, letter):
        if letter in "hl":
            self.modes[numbers[1:]] = letter == "h"
            if numbers == "?1049":
                self._clear()
        elif letter == "H":
            place = [int(n) for n in numbers.split(";")] if numbers else [1, 1]
            self.row, self.column = place[0] - 1, place[1] - 1
        elif letter == "J" and numbers == "2":
            self.rows = [[" "] * self.columns for _ in range(self.lines)]
        elif letter == "K" and self.row < self.lines:
            at = min(self.column, self.columns - 1)
            self.rows[self.row][at:] = [" "] * (self.columns - at)
        elif letter not in "mAK":
            raise AssertionError(f"the screen sent {numbers}{letter}")

    def _put(self, character):
        if character == "\r":
            self.column = 0
        elif character == "\n":
            self._down()
        else:
            if self.column >= self.columns and self.modes["7"]:
                self.column = 0
                self._down()
            at = min(self.column, self.columns - 1)
            if self.row < self.lines:
                self.rows[self.row][at] = character
            self.column += 1

    def _down(self):
        self.row += 1
        if self.row >= self.lines:
            self.row, self.scrolled = self.lines - 1, self.scrolled + 1
            self.rows = [*self.rows[1:], [" "] * self.columns]

    @property
    def text(self):
        return "\n".join("".join(row).rstrip() for row in self.rows)


def _at_a_terminal():
    hear()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


class User:
    """Starts a program in a terminal of its own, types, and looks.

    `warm`: what `WarmPopen` is told; None: a process of its own from the first line on.
    """

    def __init__(self, *words, columns=80, lines=24, term="xterm", warm=None):
        self._ours, self._theirs = os.openpty()
        self.screen = SeenScreen(columns, lines)
        self._set_size(columns, lines)
        self.before = termios.tcgetattr(self._theirs)
        self.sent = ""  # all that the program wrote
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        given = dict.fromkeys(("stdin", "stdout", "stderr"), self._theirs)
        path = os.pathsep.join(sys.path)
        given["env"] = {**os.environ, "TERM": term, "PYTHONPATH": path}
        if warm is not None:
            self.process = WarmPopen(words, **warm, **given)
        else:
            self.process = subprocess.Popen(
                [sys.executable, *map(str, words)],
                start_new_session=True,
                preexec_fn=_at_a_terminal,
                **given,
            )

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.process.kill()
        self.process.wait()
        self.hang_up()

    def hang_up(self):
        """Cut the line."""
        for end in (self._ours, self._theirs):
            with contextlib.suppress(OSError):
                os.close(end)

    @property
    def restored(self):
        """Whether the terminal is as it was before the program."""
        modes = self.screen.modes
        shown = modes["25"] and modes["7"] and not modes["1049"]
        return shown and termios.tcgetattr(self._theirs) == self.before

    def _set_size(self, columns, lines):
        size = struct.pack("HHHH", lines, columns, 0, 0)
        fcntl.ioctl(self._ours, termios.TIOCSWINSZ, size)

    def resize(self, columns, lines):
        self.screen.resize(columns, lines)
        self._set_size(columns, lines)

    def type(self, data):
        os.write(self._ours, data)

    def look(self, seconds=0.05):
        if select.select([self._ours], [], [], seconds)[0]:
            text = self._decoder.decode(os.read(self._ours, 65536))
            self.sent += text
            self.screen.feed(text)

    def see(self, pattern):
        """Look until the screen matches, and return the match."""
        return self._until(lambda: re.search(pattern, self.screen.text), pattern)

    def gone(self, pattern):
        """Look until the screen does not match any more."""
        self._until(lambda: not re.search(pattern, self.screen.text), pattern)

    def read(self, pattern):
        """Look until all that was ever written matches, and return the match."""
        return self._until(lambda: re.search(pattern, self.sent), pattern)

    def end(self):
        """Look until the program ends, and return its exit code."""
        self._until(lambda: self.process.poll() is not None, "the end")
        while select.select([self._ours], [], [], 0)[0]:
            self.look()
        return self.process.returncode

    def _until(self, found, what):
        begun, busy = time.monotonic(), computed(self.process.pid)
        while not (match := found()):
            late = time.monotonic() - begun > IDLE * PATIENCE
            late = late or computed(self.process.pid) - busy > PATIENCE
            assert not late, f"no {what} in\n{self.screen.text}\n{self.sent[-999:]!r}"
            self.look()
        return match
