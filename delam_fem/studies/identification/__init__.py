"""Identify a rig: bending stiffness, damping, gap and restitution from measured motions."""
