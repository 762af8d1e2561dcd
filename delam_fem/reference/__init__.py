"""The judge: its own loop and contact, and the comparison with it."""
