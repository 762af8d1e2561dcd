"""What to compute: frozen, strict sections, read from TOML."""
