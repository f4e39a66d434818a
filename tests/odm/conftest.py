"""Maps that several tests of the planner share; built once a session."""

import pytest
from carrying import build_carrying_map


@pytest.fixture(scope="session")
def carrying_map(tmp_path_factory):
    """The small arm's map with a payload layer, as it is read from disk."""
    return build_carrying_map(tmp_path_factory.mktemp("maps") / "arm3")
