"""Sweeps over keys of a case, resumable, on any executor."""
