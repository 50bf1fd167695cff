"""What can be wrong with a lens or with the light sent into it."""

from __future__ import annotations

from raymap.model.errors import RayMapError

__all__ = ["LensError"]


class LensError(RayMapError, ValueError):
    """A lens cannot exist, or rays, states or options handed to it make no sense."""
