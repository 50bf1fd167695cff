"""Ray files: lists of rays that optical programs exchange, read and written without a scene.

>>> from raymap import rayfiles
>>> rays = rayfiles.read("led.tm25ray")                                  # doctest: +SKIP
>>> rayfiles.write(rays, "led.sdf")                                      # doctest: +SKIP

One module per format: `raymap.rayfiles.tm25` (IES TM-25) and `raymap.rayfiles.zemax` (Zemax source
files, .dat and .sdf); others register theirs under the entry-point group ``raymap.ray_formats``.
`RaySet` is what they have in common: plain arrays with units.
"""

from __future__ import annotations

from raymap.rayfiles.format import RayFileWriter
from raymap.rayfiles.formats import RAY_FORMATS, create, read, write
from raymap.rayfiles.rays import FluxFrom, RayFileError, RaySet, Spectrum

__all__ = [
    "RAY_FORMATS",
    "FluxFrom",
    "RayFileError",
    "RayFileWriter",
    "RaySet",
    "Spectrum",
    "create",
    "read",
    "write",
]
