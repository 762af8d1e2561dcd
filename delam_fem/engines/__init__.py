"""Engines: interchangeable implementations that compute the time steps."""
