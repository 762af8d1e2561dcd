"""Export fields of displacement and moment to other programs."""
