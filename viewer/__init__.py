"""Pictures of ray maps: scenes with rays, and the interactive application.

Names are loaded when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from viewer.app.server import view
    from viewer.drawn.state import Camera, Clip, Section, ViewState, load_state, save_state
    from viewer.export import export_3d
    from viewer.paint.charts import chart
    from viewer.paint.rendering import picture
    from viewer.shown.plotting import plotter

_HOME = {
    "Camera": "viewer.drawn.state",
    "Clip": "viewer.drawn.state",
    "Section": "viewer.drawn.state",
    "ViewState": "viewer.drawn.state",
    "chart": "viewer.paint.charts",
    "export_3d": "viewer.export",
    "load_state": "viewer.drawn.state",
    "picture": "viewer.paint.rendering",
    "plotter": "viewer.shown.plotting",
    "save_state": "viewer.drawn.state",
    "view": "viewer.app.server",
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
