"""Many lines as one binary glTF: one pixel wide, and drawn in one call.

Lines of a width are drawn as several triangles each: of 73 000 edges a processor that
draws itself makes one picture in seconds (docs/decisions/0068).
"""

import json

import numpy as np

_MAGIC, _VERSION = 0x46546C67, 2  # "glTF"
_JSON, _BINARY = 0x4E4F534A, 0x004E4942  # kinds of chunks
_FLOAT, _LINES = 5126, 1


def line_file(
    segments: np.ndarray, colour: tuple[int, int, int], opacity: float
) -> bytes:
    """Return a binary glTF of line segments.

    Args:
        segments: (n, 2, 3) their ends [m], n > 0.
        colour: 0 to 255, sRGB.
        opacity: 0 to 1; below 1 what lies behind many of them is seen, too.
    """
    points = np.ascontiguousarray(segments, np.float32).reshape(-1, 3)
    shade = [_linear(c / 255.0) for c in colour]
    told = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0}, "mode": _LINES, "material": 0}
                ]
            }
        ],
        "materials": [
            {
                "pbrMetallicRoughness": {"baseColorFactor": [*shade, opacity]},
                "alphaMode": "BLEND",
            }
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": _FLOAT,
                "count": len(points),
                "type": "VEC3",
                "min": points.min(axis=0).tolist(),
                "max": points.max(axis=0).tolist(),
            }
        ],
        "bufferViews": [{"buffer": 0, "byteLength": points.nbytes}],
        "buffers": [{"byteLength": points.nbytes}],
    }
    head = json.dumps(told).encode()
    head += b" " * (-len(head) % 4)
    chunks = _chunk(_JSON, head) + _chunk(_BINARY, points.tobytes())
    return _words(_MAGIC, _VERSION, 12 + len(chunks)) + chunks


def _chunk(kind: int, data: bytes) -> bytes:
    return _words(len(data), kind) + data


def _words(*numbers: int) -> bytes:
    return np.array(numbers, "<u4").tobytes()


def _linear(c: float) -> float:
    """Return a share of light of a share in sRGB, as glTF has colours."""
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
