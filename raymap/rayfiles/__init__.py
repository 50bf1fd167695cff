"""Ray files: lists of rays that optical programs exchange, read and written without a scene.

>>> from raymap import rayfiles
>>> rays = rayfiles.read("led.tm25ray")                                  # doctest: +SKIP
>>> rayfiles.write(rays, "led.sdf")                                      # doctest: +SKIP

One module per format: `raymap.rayfiles.tm25` (IES TM-25) and `raymap.rayfiles.zemax` (Zemax source
files, .dat and .sdf). `RaySet` is what they have in common: plain arrays with units.
"""

from __future__ import annotations

from raymap.rayfiles.formats import SUFFIXES, RayFileWriter, create, read, write
from raymap.rayfiles.rays import FluxFrom, RayFileError, RaySet, Spectrum

__all__ = [
    "SUFFIXES",
    "FluxFrom",
    "RayFileError",
    "RayFileWriter",
    "RaySet",
    "Spectrum",
    "create",
    "read",
    "write",
]
