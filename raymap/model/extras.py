"""Optional packages: which extra of Raymap brings a module that is not installed."""

from __future__ import annotations

import importlib

from raymap.model.errors import MissingExtra

__all__ = ["EXTRAS", "missing_extra", "require"]

EXTRAS = {
    "view": (
        "PIL", "matplotlib", "tifffile", "trame", "trame_client", "trame_server", "trame_vuetify",
    ),
    "vtk": ("pyvista", "vtk", "vtkmodules"),
    "mesh": ("trimesh",),
    "fit": ("scipy",),
    "lens": ("opticalglass",),
    "cad": ("OCP", "ezdxf"),
    "cluster": ("distributed", "dask"),
    "remote": ("fsspec",),
    "mitsuba": ("mitsuba",),
}  # fmt: skip
"""Modules that each extra brings."""


def missing_extra(error: ImportError) -> MissingExtra | None:
    """The error that names the extra; None where no extra brings the module."""
    module = (error.name or "").partition(".")[0]
    for extra, modules in EXTRAS.items():
        if module in modules:
            return MissingExtra(
                f"this needs the package of the module {module}, which is not installed: "
                f"pip install 'raymap[{extra}]'"
            )
    return None


def require(*modules: str) -> None:
    """Import the modules, before anything is computed that they would write.

    Raises
    ------
    MissingExtra
        One of them is not installed.
    """
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise missing_extra(error) or error from None
