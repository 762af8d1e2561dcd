"""Reproduction of one paper: its figures, its numbers and its claims."""
