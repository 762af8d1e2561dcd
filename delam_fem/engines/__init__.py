"""Engines: interchangeable implementations of the time steps."""
