"""Pure mathematics that knows nothing of the package."""
