"""Periodic orbits: find them, judge their stability, follow them through bifurcations."""
