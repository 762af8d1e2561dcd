"""Families of engines that compute the same steps."""
