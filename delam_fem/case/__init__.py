"""Describe what to compute: a case of frozen, strict sections, read from TOML."""
