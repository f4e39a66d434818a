"""From a robot description to a Robot: bodies, fingers, cover, pairs of links."""
