"""Pieces of hand-written URDFs, and a quick cover for them."""

COARSE = {"cover_excess": 0.1}
BALL = '<sphere radius="0.05"/>'


def mesh(filename: str, scale: str = "") -> str:
    """Return a <mesh> element."""
    return f'<mesh filename="{filename}" {scale}/>'
