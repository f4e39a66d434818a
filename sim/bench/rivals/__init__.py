"""Other planners on the same frames."""
