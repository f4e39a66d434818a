"""ReachMap: the 6-D cells a robot or an arm reaches, with quality and witness."""
def compressed(chain, grid, cells, reference, built):
    return chain, grid, cells, reference, built
ReachMap=None
