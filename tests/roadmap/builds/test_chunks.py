"""Chunks: the same bytes whoever does them; finished ones stay; faults are named."""

import errno

import numpy as np
import pytest
from chunk_jobs import chunks, job

import roadmap.builds.chunks
from roadmap.builds.chunks import (
    ChunkFailed,
    ChunkStore,
    Threads,
    about,
    chunk_name,
    packed,
    unpacked,
)
from roadmap.errors import BuildRefused


def joined(found):
    return np.concatenate([arrays[0] for arrays in found])


@pytest.mark.parametrize("threads", [1, 3])
def test_chunks_come_in_order_from_any_number_of_threads(threads):
    found = list(Threads(threads).map(job("squares"), chunks()))
    assert np.array_equal(joined(found), np.arange(40.0) ** 2)
    assert all(arrays[1] == 4 for arrays in found)


def test_only_a_few_chunks_are_made_ahead_of_those_that_are_taken():
    made = []

    def counted():
        for chunk in chunks(400):
            made.append(chunk)
            yield chunk

    stream = Threads(2).map(job("squares"), counted())
    next(stream)
    assert len(made) < 12
    stream.close()


def test_a_build_goes_on_from_finished_chunks_and_does_damaged_ones_again(tmp_path):
    store = ChunkStore(tmp_path / "chunks")
    stream = Threads(1, store).map(job("squares"), chunks())
    for _ in range(5):
        next(stream)
    stream.close()  # as if it was killed: what was finished stays
    kept = sorted(store.folder.iterdir())
    assert 5 <= len(kept) < 10
    kept[0].write_bytes(kept[0].read_bytes()[:-1])
    kept[1].write_bytes(b"")
    (store.folder / ".half.written").write_bytes(b"x")
    again = ChunkStore(store.folder)
    found = list(Threads(1, again).map(job("squares"), chunks()))
    assert np.array_equal(joined(found), np.arange(40.0) ** 2)
    assert again.found == len(kept) - 2
    again.clear()
    assert not store.folder.exists()


def test_what_a_chunk_depends_on_changes_its_name(monkeypatch):
    one, other = chunks()[:2]
    plain = job("squares").key()
    assert chunk_name(plain, one) == chunk_name(job("squares").key(), one)
    assert chunk_name(plain, one) != chunk_name(plain, other)
    assert plain != job("squares", 0.1).key() and plain != job("not_seven").key()
    told = about() | {"numpy": "1.0"}
    monkeypatch.setattr(roadmap.builds.chunks, "about", lambda: told)
    assert plain != job("squares").key()


def test_arrays_come_back_from_bytes_as_they_were():
    arrays = (np.zeros((0, 3), np.uint16), np.arange(6.0).reshape(2, 3), np.array([1]))
    for a, b in zip(arrays, unpacked(packed(arrays)), strict=True):
        assert a.dtype == b.dtype and np.array_equal(a, b) and a.shape == b.shape


def test_an_item_that_raises_is_named():
    with pytest.raises(ChunkFailed, match=r"number 7 failed: ValueError \(it is seven"):
        list(Threads(2).map(job("not_seven"), chunks()))


def test_a_full_disk_is_told_in_one_sentence(tmp_path, monkeypatch):
    def full(path, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(roadmap.builds.chunks, "put_file", full)
    store = ChunkStore(tmp_path / "chunks")
    with pytest.raises(BuildRefused, match="the disk is full; make room, and give"):
        list(Threads(1, store).map(job("squares"), chunks()))


def test_a_spec_that_has_no_plain_content_is_refused():
    with pytest.raises(TypeError, match="spec holds a function"):
        job("squares", spec=joined).key()
