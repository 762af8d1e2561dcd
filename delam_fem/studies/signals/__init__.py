"""Measured motions, responses and gaps: read, laid over a run, taken along a surface."""
