"""GraspSet: the grasps of one object by one hand, stored whole, hashed and checked."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from handover.grasps.objects import GraspObject, make_object
from odm.obstacles.shapes import Mesh
from roadmap.arrays import freeze
from roadmap.builds.store import made_of, read_folder, write_folder
from roadmap.errors import BadMap
from roadmap.ranges import check_path

_KIND = "grasp set"
_ARRAYS = {
    "T_object_palm": np.float64,
    "values": np.float64,
    "preshape": np.float64,
    "quality": np.float64,
    "sample": np.int32,
    "contact_ptr": np.int64,
    "contact_point": np.float64,
    "contact_normal": np.float64,
    "contact_link": np.int32,
}


@dataclass(frozen=True, eq=False)
class GraspSet:
    """Grasps of an object, each by force closure.

    Attributes:
        thing: The object.
        hand: Name of the hand.
        joints: (k,) its driving joints, the order of `values`.
        links: (n,) its links, that `contact_link` counts.
        T_object_palm: (g, 4, 4) palm frame at each grasp [m].
        values: (g, k) joints of the closed hand [rad or m].
        preshape: (g, k) joints of the open hand that it was closed from.
        quality: (g,) radius of the ball of wrenches it withstands; see `holding`.
        sample: (g,) number of the surface point that it was made above.
        contact_ptr, contact_point, contact_normal, contact_link: Grasp g touches at
            contacts ptr[g]:ptr[g + 1]: (c, 3) object frame [m], inward, link.
        built: Settings, counts of what was refused and why, seconds.
        hash: SHA-256 of the stored set, "" before.
    """

    thing: GraspObject
    hand: str
    joints: tuple[str, ...]
    links: tuple[str, ...]
    T_object_palm: np.ndarray
    values: np.ndarray
    preshape: np.ndarray
    quality: np.ndarray
    sample: np.ndarray
    contact_ptr: np.ndarray
    contact_point: np.ndarray
    contact_normal: np.ndarray
    contact_link: np.ndarray
    built: dict = field(default_factory=dict)
    hash: str = ""

    def __post_init__(self) -> None:
        freeze(self, **_ARRAYS)

    def __len__(self) -> int:
        return len(self.quality)

    def save(self, path: str | Path) -> Path:
        """Write the set to a folder, whole or not at all; an old one is replaced."""
        settings = self.built.get("settings", {})
        manifest = {
            "kind": _KIND,
            "hand": self.hand,
            "joints": list(self.joints),
            "links": list(self.links),
            "object": {
                "name": self.thing.name,
                "parts": len(self.thing.parts),
                "hash": self.thing.fingerprint(),
            },
            "settings": settings,
            "built": {k: v for k, v in self.built.items() if k != "settings"},
        }
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        arrays["masses"] = self.thing.masses
        for k, part in enumerate(self.thing.parts):
            arrays[f"part{k}.vertices"] = part.vertices
            arrays[f"part{k}.faces"] = part.faces
        return write_folder(path, manifest, arrays)


def load_grasps(path: str | Path) -> GraspSet:
    """Load a stored set of grasps, every byte compared with its SHA-256.

    Raises:
        BadMap: No grasp set, or one that is truncated, altered or of another version.
    """
    path = check_path("the folder of a grasp set", path)
    if not (path / "manifest.json").is_file():
        raise BadMap(
            f"{path} holds no grasp set; build one with `odm grasps build --object "
            "hammer --hand sdh --out DIR`"
        )
    manifest, arrays = read_folder(path)
    if manifest.get("kind") != _KIND:
        raise BadMap(
            f"{path} holds a {manifest.get('kind')!r}, not a grasp set; build one with "
            "`odm grasps build --object hammer --hand sdh --out DIR`"
        )
    with made_of(path):
        parts = [
            Mesh(arrays[f"part{k}.vertices"], arrays[f"part{k}.faces"])
            for k in range(manifest["object"]["parts"])
        ]
        thing = make_object(manifest["object"]["name"], parts, arrays["masses"])
        return GraspSet(
            thing=thing,
            hand=manifest["hand"],
            joints=tuple(manifest["joints"]),
            links=tuple(manifest["links"]),
            **{name: arrays[name] for name in _ARRAYS},
            built={**manifest["built"], "settings": manifest["settings"]},
            hash=manifest["hash"],
        )
