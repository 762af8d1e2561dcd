"""Refinement studies: refine elements and steps by several methods, and measure convergence."""
