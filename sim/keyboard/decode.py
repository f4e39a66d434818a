"""From the bytes a terminal sends to names of keys."""

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left", "H": "home"}
_NUMBERED = {"1": "home", "5": "pageup", "6": "pagedown", "7": "home"}
_ESCAPE = 0x1B
_LONGEST = 24  # bytes of a sequence; what is longer is line noise


class KeyDecoder:
    """Turns bytes into names of keys, in whatever pieces they arrive.

    A printable character is its own name; arrows and the page keys have words. What
    is not known is left out. No clock decides what an escape means, so that a
    sequence that a slow line tears apart is the same key as a whole one; the escape
    key alone means nothing here and waits for what follows.
    """

    def __init__(self) -> None:
        """Start between two keys."""
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
