"""Check the package against an independent reference with its own matrices, loop and contact."""
