"""Ray maps: every light path of a Monte Carlo trace in one file.

Names are loaded when they are first used, so that ``import raymap`` is quick and loads no compiler.
"""

from __future__ import annotations

import os
import sys

if (
    sys.argv[:1] == ["-m"]
    and not sys.flags.safe_path
    and "-m raymap" in " ".join(sys.orig_argv)
    and sys.path[:1] != [os.path.dirname(os.path.dirname(os.path.abspath(__file__)))]
):
    # Python has put the current folder first, whatever modules a stranger has left there
    del sys.path[0]

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from raymap.encoding.paths import MergedPaths, PathDictionary
    from raymap.file.checks import check_portion
    from raymap.file.mixed import write_mix
    from raymap.file.opening import open
    from raymap.file.reader import Damage, RayMap
    from raymap.file.selection import copy_selection
    from raymap.file.stored import StoredPortion
    from raymap.file.writer import RayMapWriter
    from raymap.model.directory import (
        BoundingSphere,
        ChannelSet,
        Detector,
        Directory,
        DisplayMesh,
        Face,
        FaceTable,
        InputFile,
        Medium,
        Quadric,
        SceneObject,
        Source,
        Surface,
    )
    from raymap.model.errors import (
        CriterionError,
        DamagedPortion,
        DamageWarning,
        FormatError,
        InvalidPortion,
        LimitExceeded,
        MapExists,
        MapLocked,
        MeasurementError,
        MissingExtra,
        NotARayMap,
        RayMapError,
        RayNotFound,
        SceneError,
        SceneMismatch,
        UnknownName,
        UnsupportedVersion,
    )
    from raymap.model.events import ENDINGS, FAMILIES, Event, event_names
    from raymap.model.portion import Descriptors, Portion
    from raymap.model.rows import join_portions, take_rays
    from raymap.model.schema import DESCRIPTOR_DTYPE, SEGMENT_DTYPE
    from raymap.remote.client import connect
    from raymap.tables.arrow import export

_PLACES = {
    "raymap.tables.arrow": ["export"],
    "raymap.file.checks": ["check_portion"],
    "raymap.remote.client": ["connect"],
    "raymap.model.directory": [
        "BoundingSphere",
        "ChannelSet",
        "Detector",
        "Directory",
        "DisplayMesh",
        "Face",
        "FaceTable",
        "InputFile",
        "Medium",
        "Quadric",
        "SceneObject",
        "Source",
        "Surface",
    ],
    "raymap.model.errors": [
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
        "NotARayMap",
        "RayMapError",
        "RayNotFound",
        "SceneError",
        "SceneMismatch",
        "UnknownName",
        "UnsupportedVersion",
    ],
    "raymap.model.events": ["ENDINGS", "FAMILIES", "Event", "event_names"],
    "raymap.file.mixed": ["write_mix"],
    "raymap.file.opening": ["open"],
    "raymap.encoding.paths": ["MergedPaths", "PathDictionary"],
    "raymap.model.portion": ["Descriptors", "Portion"],
    "raymap.file.reader": ["Damage", "RayMap"],
    "raymap.model.schema": ["DESCRIPTOR_DTYPE", "SEGMENT_DTYPE"],
    "raymap.model.rows": ["join_portions", "take_rays"],
    "raymap.file.selection": ["copy_selection"],
    "raymap.file.stored": ["StoredPortion"],
    "raymap.file.writer": ["RayMapWriter"],
}
_HOME = {name: module for module, names in _PLACES.items() for name in names}

__version__ = "0.1.0"
__all__ = [
    "DESCRIPTOR_DTYPE",
    "ENDINGS",
    "FAMILIES",
    "SEGMENT_DTYPE",
    "BoundingSphere",
    "ChannelSet",
    "CriterionError",
    "Damage",
    "DamageWarning",
    "DamagedPortion",
    "Descriptors",
    "Detector",
    "Directory",
    "DisplayMesh",
    "Event",
    "Face",
    "FaceTable",
    "FormatError",
    "InputFile",
    "InvalidPortion",
    "LimitExceeded",
    "MapExists",
    "MapLocked",
    "MeasurementError",
    "Medium",
    "MergedPaths",
    "MissingExtra",
    "NotARayMap",
    "PathDictionary",
    "Portion",
    "Quadric",
    "RayMap",
    "RayMapError",
    "RayMapWriter",
    "RayNotFound",
    "SceneError",
    "SceneMismatch",
    "SceneObject",
    "Source",
    "StoredPortion",
    "Surface",
    "UnknownName",
    "UnsupportedVersion",
    "check_portion",
    "connect",
    "copy_selection",
    "event_names",
    "export",
    "join_portions",
    "open",
    "take_rays",
    "write_mix",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'raymap' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
