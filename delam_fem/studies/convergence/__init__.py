"""Refine a case in elements and steps by several methods (a ladder) and measure the convergence."""
