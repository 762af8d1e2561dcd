"""Laminae as solids in two or three dimensions: meshes, elasticity, contact between surfaces."""
