"""How our loops are compiled, linked and kept; what is stale is dropped."""
