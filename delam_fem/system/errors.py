"""The error that tells a user what is wrong with the input."""

from __future__ import annotations


class CaseError(ValueError):
    """Report bad input; the message names the key, what was expected and what was given."""
