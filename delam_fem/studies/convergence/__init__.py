"""Ladders of runs in elements and steps."""
