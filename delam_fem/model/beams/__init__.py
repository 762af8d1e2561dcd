"""Laminae as beams: separate, bonded in layers, or one over ground."""
