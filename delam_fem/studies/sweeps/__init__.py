"""Compute a case at many points of a grid (a sweep), resumable, on any executor or in shards."""
