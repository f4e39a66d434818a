"""Everything that moves, draws or talks to a user: loop, person, pictures, tables."""

__all__ = ["Viewer"]


def __getattr__(name: str) -> object:
    """Return `Viewer`, which is imported when it is asked for: --help is quick."""
    if name == "Viewer":
        from sim.view import Viewer

        return Viewer
    raise AttributeError(f"module 'sim' has no attribute {name!r}")
