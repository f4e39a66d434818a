"""A recipe as TOML text, which `odm build` reads back as the same recipe."""

import json
from pathlib import Path
from typing import Any

from odm.cell_map.recipe import Recipe

_NOTE = "# The recipe of a recorded run's map; `odm build` makes the map from it.\n"


def recipe_text(recipe: Recipe) -> str:
    """Return the recipe as TOML; what is None is left out, as that is its default."""
    table = recipe.as_dict()
    table["safety"] = {k: v for k, v in table["safety"].items() if k != "m"}
    parts = [_NOTE + f"name = {_value(table['name'])}\n"]
    parts += [_section(f"[{name}]", table[name]) for name in ("robot", "roadmap")]
    parts.append(_section("[safety]", table["safety"]))
    if table.get("payload"):
        parts.append(_section("[payload]", table["payload"]))
    parts += [_section("[[scenery]]", solid) for solid in table["scenery"]]
    return "\n".join(parts)


def lost_files(recipe: Recipe, folder: Path) -> list[str]:
    """Return the relative paths that a recipe written to `folder` does not find there.

    A recipe keeps them as they were given where its map was built, and they are part
    of the map's hash.
    """
    named = [recipe.robot.source, recipe.robot.srdf]
    named += [solid.get("file") for solid in recipe.scenery]
    paths = [Path(name) for name in named if name and Path(name).suffix]
    return [str(p) for p in paths if not p.is_absolute() and not (folder / p).exists()]


def _section(head: str, table: dict[str, Any]) -> str:
    rows = [f"{_key(k)} = {_value(v)}" for k, v in table.items() if v is not None]
    return "\n".join([head, *rows]) + "\n"


def _value(value: object) -> str:
    if isinstance(value, dict):
        rows = [f"{_key(k)} = {_value(v)}" for k, v in value.items()]
        return "{ " + ", ".join(rows) + " }" if rows else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value)  # inf and nan are the same words in TOML
    if isinstance(value, int):
        return str(value)
    return _string(str(value))


def _key(key: str) -> str:
    plain = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if plain else _string(key)


def _string(text: str) -> str:
    """Return a TOML basic string; JSON's escapes of it are TOML's, but for DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
