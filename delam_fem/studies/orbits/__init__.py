"""Periodic orbits: find them and judge their stability."""
