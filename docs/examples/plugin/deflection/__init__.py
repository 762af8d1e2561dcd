"""A study that somebody adds: the static deflection of a case under a force."""
