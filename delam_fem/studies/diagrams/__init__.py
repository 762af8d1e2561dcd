"""Diagrams and the page of a sweep, from its dataset."""
