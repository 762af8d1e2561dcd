"""Branches of periodic orbits over a key of a case, and the events on them."""
