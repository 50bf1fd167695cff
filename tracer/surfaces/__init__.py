"""Optical surfaces of a scene: a kind a file."""
