"""One small map and one short recording for all tests of the page."""

import pytest
from recorded import crane_recipe, new_loop, recorded

from odm import build_map, load_map
from sim.record import write_record


@pytest.fixture(scope="session")
def ending():
    """Return a list of threads that end by themselves: looked at after all tests.

    viser gives clients that left without a word 6 s; nobody has to wait for that.
    """
    threads = []
    yield threads
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()


@pytest.fixture(scope="session")
def view_map(crane_urdf, tmp_path_factory):
    folder = tmp_path_factory.mktemp("view") / "crane"
    return load_map(build_map(crane_recipe(crane_urdf), threads=1).save(folder))


@pytest.fixture(scope="session")
def view_file(view_map, tmp_path_factory):
    record = recorded(new_loop(view_map, duration_s=2.5), view_map)
    return write_record(record, tmp_path_factory.mktemp("view") / "run.npz")
