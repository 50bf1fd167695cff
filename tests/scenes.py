"""Scenes that tests of several rooms record."""

from __future__ import annotations

__all__ = ["MIRROR_BALL"]

MIRROR_BALL = """
length_unit = "mm"
[surfaces.mirror]
kind = "mirror"
reflectance = 0.7
[bodies.ball]
kind = "sphere"
radius = 2
surface = "mirror"
[sources.lamp]
kind = "collimated"
diameter = 2
position = [0, 0, -10]
direction = [0, 0, 1]
[detectors.screen]
position = [0, 0, -12]
looks = [0, 0, 1]
size = [40, 40]
cells = [8, 8]
"""
