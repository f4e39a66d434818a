"""Machine code is listed under the types it was compiled for, whoever else lists."""

import threading
import time

from numba.core.caching import IndexDataCacheFile

import roadmap.jit_options  # noqa: F401 (every loop imports it)


class Slow(IndexDataCacheFile):
    """A list that takes its time between reading and writing."""

    def _load_index(self):
        found = super()._load_index()
        time.sleep(0.05)
        return found

    def _save_index(self, overloads):
        time.sleep(0.05)
        super()._save_index(overloads)


def test_two_that_save_at_once_take_turns(tmp_path):
    kinds = [f"types {k}" for k in range(6)]
    files = [Slow(str(tmp_path), "loop", "stamp") for _ in kinds]
    jobs = [
        threading.Thread(target=file.save, args=(kind, f"code of {kind}"))
        for file, kind in zip(files, kinds, strict=True)
    ]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join(30.0)
    told = IndexDataCacheFile(str(tmp_path), "loop", "stamp")
    assert [told.load(kind) for kind in kinds] == [f"code of {kind}" for kind in kinds]


def test_a_folder_that_cannot_be_locked_is_written_all_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr("roadmap.cache_lock._LOCK", "no such folder/lock")
    file = IndexDataCacheFile(str(tmp_path), "loop", "stamp")
    file.save("types", "code")
    assert file.load("types") == "code"
