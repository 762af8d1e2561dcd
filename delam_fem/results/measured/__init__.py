"""Measured motions, responses and gaps: read, aligned with a run, compared with it."""
