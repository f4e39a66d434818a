"""The map: which cells each node and edge of a roadmap sweeps, built and stored."""
