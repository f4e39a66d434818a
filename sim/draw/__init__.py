"""Pictures and films of runs, maps, people and workspaces."""
