"""The terminal: keys without Enter, a screen of its own, both given back for sure."""

import contextlib
import os
import select
import sys
from collections.abc import Iterator, Sequence

from roadmap.errors import BadInput

# a screen of its own without cursor, where long lines are cut and do not wrap
_ENTER = "\x1b[?1049h\x1b[?25l\x1b[?7l\x1b[2J"
_LEAVE = "\x1b[0m\x1b[?7h\x1b[?25h\x1b[?1049l"
_ALL, _ERASE = "\x1b[2J", "\x1b[K"
_PLAIN = str.maketrans("─●○█░↑↓←→µ°·…", "-*o#.^v<>u'-~")  # where text is not Unicode
_READ = 1024  # bytes at a time
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left", "H": "home"}
_NUMBERED = {"1": "home", "5": "pageup", "6": "pagedown", "7": "home"}
_ESCAPE = 0x1B
_LONGEST = 24  # bytes of a sequence; what is longer is line noise


class NoTerminal(BadInput):
    """Keys were asked for where there is no terminal to read them from."""


class KeyDecoder:
    """Turns bytes into names of keys, in whatever pieces they arrive.

    A printable character is its own name; arrows and the page keys have words. What
    is not known is left out. No clock decides what an escape means, so that a
    sequence that a slow line tears apart is the same key as a whole one; the escape
    key alone means nothing here and waits for what follows.
    """

    def __init__(self) -> None:
        self._open = bytearray()

    def feed(self, data: bytes) -> list[str]:
        """Return the keys that these bytes complete."""
        keys = []
        for byte in data:
            name = self._sequence(byte) if self._open else self._single(byte)
            if name:
                keys.append(name)
        return keys

    def _single(self, byte: int) -> str | None:
        if byte == _ESCAPE:
            self._open.append(byte)
        return chr(byte) if 0x20 <= byte < 0x7F else None

    def _sequence(self, byte: int) -> str | None:
        opened = self._open
        if byte < 0x20 or byte > 0x7E:  # never inside: begin anew
            opened.clear()
            return self._single(byte)
        if len(opened) == 1 and byte not in b"[O":
            opened.clear()  # the escape key, or Alt with a key, which is that key
            return chr(byte)
        opened.append(byte)
        if len(opened) > 2 and byte >= 0x40:
            name = _name(bytes(opened))
            opened.clear()
            return name
        if len(opened) > _LONGEST:
            opened.clear()
        return None


def _name(sequence: bytes) -> str | None:
    """Return the key of a whole sequence: ESC [ numbers letter, or ESC O letter."""
    inside, last = sequence[2:-1].decode("ascii"), chr(sequence[-1])
    if last == "~":
        return _NUMBERED.get(inside.split(";")[0])
    return _ARROWS.get(last)


class Keys:
    """Reads keys from a terminal, without waiting for any."""

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._decoder = KeyDecoder()
        self.closed = False

    def read(self) -> list[str]:
        """Return the keys pressed since the last call; `closed` where none can come."""
        keys = []
        while not self.closed and select.select([self.fd], [], [], 0)[0]:
            try:
                data = os.read(self.fd, _READ)
            except OSError:  # the line was cut
                data = b""
            self.closed = not data
            keys += self._decoder.feed(data)
        return keys


class Screen:
    """Draws pictures over one another, each in one piece."""

    def __init__(self, fd: int, encoding: str = "utf-8") -> None:
        self.fd, self.encoding = fd, encoding
        self._size = (0, 0)
        self._shown: list[tuple[str, bool]] = []

    @property
    def size(self) -> tuple[int, int]:
        """Columns and lines now; 80 x 24 where the terminal does not say."""
        try:
            size = os.get_terminal_size(self.fd)
        except OSError:
            return 80, 24
        return size.columns or 80, size.lines or 24

    def enter(self) -> None:
        """Take the whole terminal."""
        self._shown = []
        self._write(_ENTER)

    def leave(self) -> None:
        """Give it back as it was; a terminal that is gone is no matter."""
        with contextlib.suppress(OSError):
            self._write(_LEAVE)

    def draw(self, lines: Sequence[tuple[str, bool]]) -> None:
        """Draw lines from the top: (text, whether it fills the whole width).

        Only lines that changed are sent. A line that is slow to take them gets
        none: pictures may be missing, but the loop does not wait for them.
        """
        if not select.select([], [self.fd], [], 0)[1]:
            return
        before, size = self._shown, self.size
        if size != self._size or len(lines) != len(before):
            before, self._size = [], size
        parts = [] if before else [_ALL]
        for row, line in enumerate(lines):
            if not before or before[row] != line:
                # what follows the last column would be erased with it
                parts.append(f"\x1b[{row + 1};1H{line[0]}{'' if line[1] else _ERASE}")
        self._shown = list(lines)
        with contextlib.suppress(OSError):  # a line that was cut: the keys tell
            self._write("".join(parts))

    def _write(self, text: str) -> None:
        if not self.encoding.lower().startswith("utf"):
            text = text.translate(_PLAIN)
        data = text.encode(self.encoding, errors="replace")
        while data:
            data = data[os.write(self.fd, data) :]


class PlainScreen(Screen):
    """A terminal that cannot go back up: lines follow one another."""

    def enter(self) -> None:
        """Take nothing."""

    def leave(self) -> None:
        """Give nothing back."""

    def draw(self, lines: Sequence[tuple[str, bool]]) -> None:
        """Write the lines below the others."""
        with contextlib.suppress(OSError):
            self._write("".join(f"{text}\r\n" for text, _ in lines))


@contextlib.contextmanager
def single_keys(fd: int) -> Iterator[None]:
    """Let keys arrive one by one and unseen; what the terminal was, it is again.

    Ctrl-C and Ctrl-Z keep their meaning. Keys pressed before and left over after are
    dropped, so that they do not end up on the shell's line.
    """
    import termios

    before = termios.tcgetattr(fd)
    mode = termios.tcgetattr(fd)
    mode[0] &= ~termios.IXON  # Ctrl-S would freeze the screen and with it the loop
    mode[3] &= ~(termios.ICANON | termios.ECHO)
    mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
    termios.tcsetattr(fd, termios.TCSAFLUSH, mode)
    try:
        yield
    finally:
        with contextlib.suppress(termios.error):
            termios.tcsetattr(fd, termios.TCSAFLUSH, before)


@contextlib.contextmanager
def taken(keys: Keys, screen: Screen) -> Iterator[None]:
    """Hold keyboard and screen while the block runs, however it ends."""
    with single_keys(keys.fd):
        try:
            screen.enter()
            yield
        finally:
            screen.leave()


def open_terminal(what_needs: str = "", instead: str = "") -> tuple[Keys, Screen]:
    """Return keys and screen of the terminal of this process, or raise NoTerminal.

    Args:
        what_needs: What was asked for; empty: the motion of `odm run`.
        instead: What to ask for without a terminal; empty: its other motions.
    """
    streams = [s for s in (sys.stdout, sys.stderr) if _is_terminal(s)]
    for missing, what in (
        (not _is_terminal(sys.stdin), "standard input is none"),
        (not streams, "neither standard output nor standard error is one"),
    ):
        if missing:
            raise NoTerminal(
                f"{what_needs or 'motion keyboard'} needs a terminal, but {what}; run "
                f"it in one, or {instead or _others()}"
            )
    stream = streams[0]
    stream.flush()
    dumb = os.environ.get("TERM", "") in ("", "dumb", "unknown")
    made = PlainScreen if dumb else Screen
    return Keys(sys.stdin.fileno()), made(stream.fileno(), stream.encoding)


def _is_terminal(stream: object) -> bool:
    try:
        return os.isatty(stream.fileno())
    except (AttributeError, OSError, ValueError):  # absent, not a file, or closed
        return False


def _others() -> str:
    from sim.people.human_motion import motion_names

    others = [name for name in motion_names() if name != "keyboard"]
    return f"choose another motion: {', '.join(others)}"
