"""What obstacles are: shapes, points on their surfaces, and the cells they occupy."""
