"""`load_scene`: a scene by name, drawn by seed, or one of your own from a TOML file."""

from pathlib import Path

from handover.scenes.paper import PAPER_SCENES
from handover.scenes.scene import Scene
from handover.scenes.scene_file import read_scene
from handover.scenes.start_check import check_start
from handover.scenes.varied import varied
from roadmap.errors import BadInput, did_you_mean
from roadmap.ranges import check_number, check_path

_SCENES = {**PAPER_SCENES, "varied": varied}


def scene_names() -> list[str]:
    """Return the names that `load_scene` takes in place of a file."""
    return sorted(_SCENES)


def load_scene(source: str | Path, seed: int = 0) -> Scene:
    """Return a scene.

    Args:
        source: One of `scene_names()`, or the path of a TOML file; see
            `docs/plans.md`.
        seed: What its random parts are drawn with: same seed, same bytes. A file has
            none of them.

    Raises:
        BadInput: No such name or file, a file with a missing or unknown part, or a
            start in collision; says what would help.
    """
    check_number("seed", seed, 0, 2**31, whole=True)
    path = check_path("a scene", source, "give its name or the path of a .toml file")
    if str(source) in _SCENES:
        scene = _SCENES[str(source)](int(seed))
    elif path.suffix == ".toml" or path.is_file():
        scene = read_scene(path, int(seed))
    else:
        raise BadInput(
            f"there is no scene {str(source)!r}; {did_you_mean(source, scene_names())} "
            f"one of {', '.join(scene_names())} or the path of a .toml file"
        )
    check_start(scene)
    return scene
