"""The present frame: points, hand, base and place; what is free of them."""
