"""Whole periods in code that Numba compiles."""
