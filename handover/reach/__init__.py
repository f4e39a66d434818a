"""What a chain reaches, as a 6-D map of cells with quality and witness."""
