"""Compiled code on disk that survives kills, damage and folders that cannot be written."""
