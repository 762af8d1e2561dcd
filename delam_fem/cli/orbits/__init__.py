"""The commands `delam-fem orbit` and `delam-fem continue`."""
