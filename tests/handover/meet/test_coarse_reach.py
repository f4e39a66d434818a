"""The coarse reach map of a person's arm: found once, and each time the same."""

import numpy as np
import pytest

from handover import Human, ReachSettings, build_reach_map
from handover.meet import meet_tables
from handover.meet.meet_tables import PersonTables, coarse_human_reach

BUILT = {}  # the map, once


@pytest.fixture
def found(monkeypatch, tmp_path):
    """Keep it in a folder of the test; return for which settings it was found."""
    times = []

    def count(chain, settings, threads):
        times.append(settings)
        assert chain.fingerprint() == Human().arm("right").chain().fingerprint()
        if settings not in BUILT:
            BUILT[settings] = build_reach_map(chain, settings, threads=threads)
        return BUILT[settings]

    monkeypatch.setenv("ODM_CACHE", str(tmp_path))
    monkeypatch.setattr(meet_tables, "build_reach_map", count)
    yield times
    coarse_human_reach.cache_clear()


def anew():
    coarse_human_reach.cache_clear()
    return coarse_human_reach()


def test_it_is_found_once_and_comes_back_to_the_byte(found):
    first, again = anew(), anew()
    settings = ReachSettings(cell=0.1, rotations=72, samples=20_000)
    assert found == [settings] and first is not again
    built = BUILT[settings]
    for one in (first, again):
        assert one.reference == built.reference
        assert one.chain.fingerprint() == built.chain.fingerprint()
        assert one.grid.shape == built.grid.shape
        for mine, right in zip(one.packed, built.packed, strict=True):
            assert mine.dtype == right.dtype and not mine.flags.writeable
            np.testing.assert_array_equal(mine, right)
    dexterity = PersonTables(again)._dexterity
    np.testing.assert_array_equal(dexterity, PersonTables(built)._dexterity)


def test_a_damaged_file_or_another_code_finds_it_anew(found, monkeypatch, tmp_path):
    good = anew()
    (file,) = (tmp_path / "reach").iterdir()
    data = file.read_bytes()
    for bad in (b"", data[:-8], data[:-1] + bytes([data[-1] ^ 1])):
        file.write_bytes(bad)
        assert (anew().packed.quality == good.packed.quality).all()
        assert file.read_bytes() == data
    monkeypatch.setattr(meet_tables, "code_of", lambda file: "another way to find it")
    anew()
    assert len(found) == 5
