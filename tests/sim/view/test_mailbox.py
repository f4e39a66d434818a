"""A slot between two processes: the newest letter, whole, and nobody waits."""

import os
import struct
import time

import pytest

from sim.view.mailbox import Mailbox


@pytest.fixture
def boxes():
    """Return both ends of a mailbox; the reader has a descriptor of its own."""
    writer = Mailbox(room=1000)
    reader = Mailbox(os.dup(writer.descriptor), 1000)
    yield writer, reader
    writer.close()
    reader.close()


def test_a_letter_is_taken_once(boxes):
    writer, reader = boxes
    assert reader.take() is None
    assert writer.put(b"first")
    assert reader.take() == b"first"
    assert reader.take() is None


def test_only_the_newest_letter_is_there(boxes):
    writer, reader = boxes
    for i in range(100):
        writer.put(f"letter {i}".encode())
    assert reader.take() == b"letter 99"
    assert reader.take() is None


def test_a_letter_too_large_is_refused_and_the_old_one_stays(boxes):
    writer, reader = boxes
    writer.put(b"small")
    assert not writer.put(bytes(1001))
    assert reader.take() == b"small"
    assert writer.put(bytes(1000))


def test_a_letter_that_is_being_written_is_not_read(boxes):
    writer, reader = boxes
    writer.put(b"whole")
    struct.pack_into("<Q", reader._memory, 0, 3)  # odd: the writer is at it
    assert reader.take() is None


def test_a_letter_that_was_overwritten_while_it_was_read_is_not_taken(boxes):
    writer, reader = boxes
    writer.put(b"whole")
    reader._memory[24:29] = b"other"
    assert reader.take() is None
    writer.put(b"next")
    assert reader.take() == b"next"


def test_nobody_who_writes_waits_for_a_reader(boxes):
    writer, _ = boxes
    begun = time.process_time()
    for _ in range(20_000):
        writer.put(b"x" * 1000)
    assert time.process_time() - begun < 1.0  # 50 us each, where it takes one
