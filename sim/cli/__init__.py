"""The `odm` command: one file a group of commands."""
