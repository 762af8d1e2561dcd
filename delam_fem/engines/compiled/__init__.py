"""The compiled engine: it computes whole periods in code that Numba compiles."""
