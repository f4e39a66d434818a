"""Recipes of the maps that come with the package; built maps are not kept here."""
