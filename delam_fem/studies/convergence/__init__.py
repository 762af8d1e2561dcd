"""Ladders: refine a case in elements and steps by several methods, and measure convergence."""
