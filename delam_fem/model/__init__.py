"""Discretisations: from a case to operators and a layout."""
