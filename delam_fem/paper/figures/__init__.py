"""The figures of the paper; each is a `Piece` of three functions: measure, draw, judge."""
