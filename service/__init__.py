"""The service: other programs load, record, ask and look over Arrow Flight.

It stands above all other packages; none of them knows it. Clients need `raymap.connect` at most, or
any Arrow Flight library; the protocol is described in ``docs/service.md``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from service.limits import Limits
    from service.server import RaymapService, serve

_HOME = {"Limits": "service.limits", "RaymapService": "service.server", "serve": "service.server"}

__all__ = ["Limits", "RaymapService", "serve"]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'service' has no attribute {name!r}")
