"""Where maps lie, and what is refused before one is written."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from odm import Recipe

MAPS = Path("maps/built")
REACH_MAPS = MAPS / "reach"
GRASPS = MAPS / "grasps"


def folder_of_map(name: str, wanted: str) -> Path | None:
    """Return the folder of maps/built that holds the map of a hash; None: no such.

    That of the map's name is looked at first; `odm build --out` gives others.
    """
    there = sorted(path for path in MAPS.glob("*") if path.is_dir())
    return next((p for p in (MAPS / name, *there) if _told(p, "hash") == wanted), None)


def _told(folder: Path, key: str) -> str | None:
    """Return what the manifest of a folder says, None where it says nothing."""
    try:
        text = (folder / "manifest.json").read_text(encoding="utf-8")
        return json.loads(text)[key]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def check_map_folder(target: Path, recipe: "Recipe", force: bool) -> None:
    """Refuse to replace another map or folder, before any work."""
    from odm.cell_map.recipe import recipe_of_map
    from roadmap.builds.store import read_folder
    from roadmap.errors import BuildRefused, PlanningError

    if not target.exists():
        return
    if not (target / "manifest.json").is_file():
        raise _refused(target, "is not a map folder")
    if force:
        return
    try:
        found = read_folder(target, verify=False)[0]["recipe"]
        same = recipe_of_map(found).as_dict() == recipe.as_dict()
    except (PlanningError, KeyError, TypeError):
        return  # a damaged map, or one of another version: nothing is lost
    if not same:
        raise BuildRefused(
            f"{target} holds the map of another recipe; choose another --out, or "
            "replace it with --force"
        )


def check_kind_of(target: Path, wanted: str) -> None:
    """Refuse to replace what is no "reach map" or "grasp set", before any work."""
    if target.exists() and _told(target, "kind") != wanted:
        raise _refused(target, f"holds no {wanted}")


def _refused(target: Path, what: str) -> Exception:
    from roadmap.errors import BuildRefused

    return BuildRefused(
        f"{target} exists and {what}, so it is left alone; choose another --out or "
        "remove it yourself"
    )
