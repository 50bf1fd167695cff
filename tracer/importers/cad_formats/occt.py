"""The modules of OpenCASCADE, loaded when a CAD file is read."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

from raymap.model.errors import MissingExtra

__all__ = ["occt"]


@cache
def occt(module: str) -> Any:
    """A module of OpenCASCADE's Python binding, e.g. ``occt("gp")``.

    Raises
    ------
    MissingExtra
        without the package
    """
    try:
        _silence()
        return import_module(f"OCP.{module}")
    except ImportError as error:
        raise MissingExtra(
            "reading CAD files needs OpenCASCADE (package cadquery-ocp-novtk); "
            "pip install 'raymap[cad]'"
        ) from error


@cache
def _silence() -> None:
    """Keep the library from writing on the standard output."""
    message = import_module("OCP.Message")
    messenger = message.Message.DefaultMessenger_s()
    messenger.ChangePrinters().Clear()
