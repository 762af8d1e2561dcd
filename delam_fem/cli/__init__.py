"""Define the command `delam-fem`."""
