"""Lateral impact of one lamina on the ground (paper 2.3)."""
