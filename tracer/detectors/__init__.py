"""Detectors of a scene: their keys and their cells."""
