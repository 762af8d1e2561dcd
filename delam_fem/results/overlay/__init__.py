"""A measurement laid over a run: time and phase aligned, differences in numbers and figures."""
