"""Solids of the links, the spheres that cover them, and what may touch."""
