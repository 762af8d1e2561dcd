"""Discretisations: they turn a case into operators and a layout."""
