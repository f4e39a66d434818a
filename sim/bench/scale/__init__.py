"""Maps of many sizes."""
