"""What all commands share: output, Ctrl-C, and files from elsewhere."""
