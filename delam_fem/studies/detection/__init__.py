"""Detect delaminations by what clapping adds to the motion: measure, mark, recommend, judge."""
