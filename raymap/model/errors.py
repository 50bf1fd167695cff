"""Exceptions of all Raymap packages.

::

    RayMapError
    ├── FormatError (ValueError)            the bytes are not a sound ray map
    │   ├── NotARayMap                      wrong magic, or no sound directory
    │   ├── UnsupportedVersion              written by a newer major version
    │   └── DamagedPortion                  a chunk or stream fails its checksum or its limits
    ├── MapExists (FileExistsError)         a map stands where one would be written
    ├── MapLocked (OSError)                 another writer is at work on the map
    ├── SceneMismatch (ValueError)          the map was recorded from another scene
    ├── InvalidPortion (ValueError)         arrays handed to the writer contradict each other
    ├── LimitExceeded (ValueError)          more of something than the format can number
    ├── SceneError (ValueError)             a scene description cannot be traced
    ├── MeasurementError (ValueError)       measured data cannot be used
    ├── CriterionError (ValueError)         a criterion cannot be read
    │   └── UnknownName (KeyError)          it names something the map does not have
    ├── RayNotFound (KeyError)              no ray has this number
    ├── NoRays (ValueError)                 the map was recorded without rays
    └── MissingExtra (ImportError)          an optional package is needed

Every message says what is wrong, where, what is lost, and what to do next.
"""

from __future__ import annotations

__all__ = [
    "CriterionError",
    "DamageWarning",
    "DamagedPortion",
    "FormatError",
    "InvalidPortion",
    "LimitExceeded",
    "MapExists",
    "MapLocked",
    "MeasurementError",
    "MissingExtra",
    "NoRays",
    "NotARayMap",
    "RayMapError",
    "RayNotFound",
    "SceneError",
    "SceneMismatch",
    "UnknownName",
    "UnsupportedVersion",
]


class RayMapError(Exception):
    """Root of everything that Raymap raises on purpose; commands print it as one line, exit 1."""

    def __str__(self) -> str:  # KeyError would quote the message
        return str(self.args[0]) if self.args else self.__class__.__name__


class FormatError(RayMapError, ValueError):
    """The bytes are not a sound ray map."""


class NotARayMap(FormatError):
    """Wrong magic, or no sound directory: nothing can be served."""


class UnsupportedVersion(FormatError):
    """The file was written by a newer major version of the format."""


class DamagedPortion(FormatError):
    """A chunk or a stream fails its checksum or declares impossible sizes."""

    reason: str = ""
    """What is wrong, without place and remedy."""


class DamageWarning(UserWarning):
    """Something of a map is damaged that costs time, but no ray."""


class MapExists(RayMapError, FileExistsError):
    """A file stands where a new one would be written."""


class MapLocked(RayMapError, OSError):
    """Another process holds the writer's lock of the map."""


class SceneMismatch(RayMapError, ValueError):
    """A map was recorded from another scene than the one it should be joined with."""


class InvalidPortion(RayMapError, ValueError):
    """Arrays handed to the writer contradict each other or the directory."""


class LimitExceeded(RayMapError, ValueError):
    """More of something than the format can number."""


class SceneError(RayMapError, ValueError):
    """A scene description cannot be traced."""


class MeasurementError(RayMapError, ValueError):
    """Measured data cannot be used; the message names the file and the row."""


class CriterionError(RayMapError, ValueError):
    """A criterion cannot be read or does not fit the map."""


class UnknownName(CriterionError, KeyError):
    """A criterion names something that the map does not have."""


class RayNotFound(RayMapError, KeyError):
    """No ray of the map has this number."""


class NoRays(RayMapError, ValueError):
    """The map holds only what detectors counted; rays cannot be asked for."""


class MissingExtra(RayMapError, ImportError):
    """An optional package is needed; the message names the extra to install."""
