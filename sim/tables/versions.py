"""Versions of installed packages, without importing them."""

from importlib import metadata


def version(package: str) -> str | None:
    """Return the version of an installed package, else None."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
