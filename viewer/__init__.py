"""Pictures of ray maps: scenes with rays, and the interactive application.

Names are loaded when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from viewer.app import view
    from viewer.charts import chart
    from viewer.models import export_3d
    from viewer.pyvista_view import plotter
    from viewer.rendering import picture
    from viewer.state import Camera, Clip, Section, ViewState, load_state, save_state

_HOME = {
    "Camera": "viewer.state",
    "Clip": "viewer.state",
    "Section": "viewer.state",
    "ViewState": "viewer.state",
    "chart": "viewer.charts",
    "export_3d": "viewer.models",
    "load_state": "viewer.state",
    "picture": "viewer.rendering",
    "plotter": "viewer.pyvista_view",
    "save_state": "viewer.state",
    "view": "viewer.app",
}

__all__ = [
    "Camera",
    "Clip",
    "Section",
    "ViewState",
    "chart",
    "export_3d",
    "load_state",
    "picture",
    "plotter",
    "save_state",
    "view",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'viewer' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
