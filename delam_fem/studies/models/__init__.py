"""One case as beams, as solids, and reduced to modes: what the models make of it."""
