"""Everything that moves, draws or talks to a user: loop, person, pictures, tables."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim.story.frame import StoryFrame
    from sim.story.handover import Handover
    from sim.story.phase import PhasePlanner
    from sim.story.settings import PARTNER, StorySettings
    from sim.view import Viewer

__all__ = [
    "PARTNER",
    "Handover",
    "PhasePlanner",
    "StoryFrame",
    "StorySettings",
    "Viewer",
]
_HOMES = {
    "Handover": "sim.story.handover",
    "PARTNER": "sim.story.settings",
    "PhasePlanner": "sim.story.phase",
    "StoryFrame": "sim.story.frame",
    "StorySettings": "sim.story.settings",
    "Viewer": "sim.view",
}


def __getattr__(name: str) -> object:
    """Return what is imported when it is asked for: --help is quick."""
    if name in _HOMES:
        from importlib import import_module

        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'sim' has no attribute {name!r}")
