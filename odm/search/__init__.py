"""One frame's search: the compiled state, the masks, A* and the path it writes."""
