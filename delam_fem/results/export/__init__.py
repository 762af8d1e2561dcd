"""The result of a run in the formats of other programs."""
