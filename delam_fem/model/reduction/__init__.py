"""Reduction of operators to modes and residual flexibility, as ordinary operators."""
