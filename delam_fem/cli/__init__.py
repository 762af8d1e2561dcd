"""The command `delam-fem`."""
