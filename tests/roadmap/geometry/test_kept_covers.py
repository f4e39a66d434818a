"""Covers that are kept: the same bytes, found once, and never a damaged one."""

import numpy as np
import pytest

from roadmap.builds.kept import cache_folder
from roadmap.geometry import kept_covers
from roadmap.geometry.kept_covers import kept_cover, kept_excess, kept_shells
from roadmap.geometry.polytope import shell
from roadmap.geometry.solids import Solid
from roadmap.geometry.spheres import cover_excess, cover_solids
from roadmap.robot.robot import BOX, SPHERE


def box(width=0.1):
    return Solid(BOX, 0, np.eye(4), (width, 0.06, 0.04), np.zeros((0, 3)))


@pytest.fixture
def found(monkeypatch, tmp_path):
    """Keep covers in a folder of the test; return how often one was found."""
    times = []

    def count(solids, excess, closely):
        times.append(excess)
        return cover_solids(solids, excess, closely)

    monkeypatch.setenv("ODM_CACHE", str(tmp_path))
    monkeypatch.setattr(kept_covers, "cover_solids", count)
    return times


def test_a_cover_is_found_once_and_comes_back_to_the_byte(found):
    first, again = kept_cover([box()], 0.02), kept_cover([box()], 0.02)
    assert len(found) == 1 and first.tobytes() == again.tobytes()
    assert (
        again.flags.writeable
        and again.tobytes() == cover_solids([box()], 0.02).tobytes()
    )


def test_another_solid_excess_closeness_or_code_is_another_cover(found, monkeypatch):
    kept_cover([box()], 0.02)
    kept_cover([box(0.1 + 1e-15)], 0.02)
    kept_cover([box()], 0.021)
    kept_cover([box()], 0.02, closely=False)
    monkeypatch.setattr(kept_covers, "code_of", lambda file: "another way to prove")
    kept_cover([box()], 0.02)
    assert len(found) == 5


def test_a_damaged_or_foreign_file_is_found_anew(found, tmp_path):
    kept_cover([box()], 0.02)
    (file,) = (tmp_path / "covers").iterdir()
    good = file.read_bytes()
    for bad in (b"", good[:-8], good[:-1] + bytes([good[-1] ^ 1]), b"x" * 64):
        file.write_bytes(bad)
        kept_cover([box()], 0.02)
        assert file.read_bytes() == good
    kept_cover([box(0.2)], 0.02)
    (other,) = {*file.parent.iterdir()} - {file}
    other.write_bytes(good)
    wide = kept_cover([box(0.2)], 0.02)
    assert wide.tobytes() == cover_solids([box(0.2)], 0.02).tobytes()
    assert len(found) == 7 and not list(file.parent.glob(".*"))


def test_where_nothing_can_be_kept_it_is_found_each_time(found, monkeypatch, tmp_path):
    blocked = tmp_path / "a file"
    blocked.write_text("")
    for place in (str(blocked), ""):
        monkeypatch.setenv("ODM_CACHE", place)
        kept_cover([box()], 0.05)
        kept_cover([box()], 0.05)
    assert len(found) == 4
    assert cache_folder() is None


def test_shells_are_found_once_and_come_back_to_the_byte(monkeypatch, tmp_path):
    ball = Solid(SPHERE, 0, np.eye(4), (0.1, 0.0, 0.0), np.zeros((0, 3)))
    times = []
    monkeypatch.setenv("ODM_CACHE", str(tmp_path))
    monkeypatch.setattr(kept_covers, "shell", lambda s: times.append(s) or shell(s))
    for solids in ([box(), ball], [box(), ball], [ball, box()], [box()], []):
        shells = kept_shells(solids)
        assert [s.tobytes() for s in shells] == [shell(s).tobytes() for s in solids]
    assert len(times) == 5
    kept_cover([box()], 0.02)
    assert len(list((tmp_path / "covers").iterdir())) == 5


def test_an_excess_is_measured_once_for_these_spheres_and_solids(monkeypatch, tmp_path):
    few, many = cover_solids([box()], 0.05), cover_solids([box()], 0.02)
    times = []
    monkeypatch.setenv("ODM_CACHE", str(tmp_path))
    monkeypatch.setattr(
        kept_covers, "cover_excess", lambda *a: times.append(a) or cover_excess(*a)
    )
    for spheres, solid in [(few, box()), (many, box()), (few, box(0.09))] * 2:
        assert kept_excess(spheres, [solid]) == cover_excess(spheres, [solid])
    assert len(times) == 3
