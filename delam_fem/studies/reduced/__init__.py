"""Cases with a few modes of each lamina: run them, and give their maps to studies of orbits."""
