"""The judge: its own matrices, loop and contact, and the comparison with it."""
