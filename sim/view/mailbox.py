"""A mailbox of one slot between two processes: the newest letter, and nobody waits."""

import mmap
import os
import struct
import zlib

ROOM = 4 << 20  # bytes of a letter
HAND = struct.Struct("<?3d")  # letter of a dragged hand: whether it is, where [m]
READY = b"ready\n"  # what the page's process says on stdout once it is open
_HEAD = struct.Struct("<QQQ")  # number of the letter (odd: being written), size, CRC


class Mailbox:
    """Memory that two processes share; one writes, the other reads.

    A new letter replaces the old one, read or not, so that neither side ever waits for
    the other. A letter is read whole or not at all: it has a number, odd while it is
    being written, and a checksum.

    Args:
        descriptor: Of memory made by another mailbox; None makes new memory.
        room: Bytes of the largest letter.

    Attributes:
        descriptor: To be handed to the other process.
    """

    def __init__(self, descriptor: int | None = None, room: int = ROOM) -> None:
        if descriptor is None:
            descriptor = os.memfd_create("odm-view")
            os.ftruncate(descriptor, _HEAD.size + room)
        self.descriptor, self.room = descriptor, room
        self._memory = mmap.mmap(descriptor, _HEAD.size + room)
        self._number = self._seen = 0

    def put(self, letter: bytes) -> bool:
        """Lay a letter into the slot; False, and nothing is done: it is too large."""
        size = len(letter)
        if size > self.room:
            return False
        crc = zlib.crc32(letter)
        _HEAD.pack_into(self._memory, 0, self._number + 1, size, crc)
        self._memory[_HEAD.size : _HEAD.size + size] = letter
        self._number += 2
        _HEAD.pack_into(self._memory, 0, self._number, size, crc)
        return True

    def take(self) -> bytes | None:
        """Return a letter that was not taken yet, None where there is none."""
        number, size, crc = _HEAD.unpack_from(self._memory, 0)
        if number == self._seen or number % 2 or size > self.room:
            return None
        letter = self._memory[_HEAD.size : _HEAD.size + size]
        if _HEAD.unpack_from(self._memory, 0)[0] != number:
            return None  # the next one came meanwhile; it is taken the next time
        if zlib.crc32(letter) != crc:
            return None
        self._seen = number
        return letter

    def close(self) -> None:
        """Give the memory back."""
        self._memory.close()
        os.close(self.descriptor)
