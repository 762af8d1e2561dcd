"""Branches of periodic orbits: follow them over a key of a case, through what happens on them."""
