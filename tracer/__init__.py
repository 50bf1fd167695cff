"""From a scene to a ray map: scenes, optics and the Monte Carlo engine that records.

Names are loaded when they are first used: importing the package loads no compiler.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tracer.run.recording import StoppedLight, record
    from tracer.run.results import Progress, RecordResult
    from tracer.scene.compile import Compilation, compile_scene
    from tracer.scene.load import load_scene, parse_scene
    from tracer.scene.model import Scene
    from tracer.studies.lens import FirstOrder, first_order
    from tracer.transport.trace import TracedRays, trace_rays

_PLACES = {
    "tracer.run.recording": ["StoppedLight", "record"],
    "tracer.run.results": ["Progress", "RecordResult"],
    "tracer.scene.compile": ["Compilation", "compile_scene"],
    "tracer.scene.load": ["load_scene", "parse_scene"],
    "tracer.scene.model": ["Scene"],
    "tracer.studies.lens": ["FirstOrder", "first_order"],
    "tracer.transport.trace": ["TracedRays", "trace_rays"],
}
_HOME = {name: module for module, names in _PLACES.items() for name in names}

__all__ = [
    "Compilation",
    "FirstOrder",
    "Progress",
    "RecordResult",
    "Scene",
    "StoppedLight",
    "TracedRays",
    "compile_scene",
    "first_order",
    "load_scene",
    "parse_scene",
    "record",
    "trace_rays",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'tracer' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
