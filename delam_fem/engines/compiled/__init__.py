"""The compiled engine, which computes whole periods in code that Numba compiles."""
