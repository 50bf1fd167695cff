"""Names of sources, objects, faces, media and detectors, as scenes and maps list them."""

from __future__ import annotations

from typing import Any

__all__ = ["names_of"]


def names_of(directory: Any) -> dict[str, Any]:
    """Sources, objects, faces, media and detectors, as scenes and maps list them."""
    return {
        "sources": [item.name for item in directory.sources],
        "objects": [item.name for item in directory.objects],
        "faces": list(directory.faces.names),
        "media": [item.name for item in directory.media],
        "detectors": [item.name for item in directory.detectors],
        "detector_grids": {
            item.name: {
                "kind": item.kind,
                "cells": list(item.cells),
                "size": list(item.size),
                "center": list(item.center),
                "axis_u": list(item.axis_u),
                "axis_v": list(item.axis_v),
                "blocking": item.blocking,
            }
            for item in directory.detectors
        },
        "source_fluxes": {item.name: item.flux for item in directory.sources},
        "units": {"length": directory.length_unit, "flux": directory.flux_unit},
    }
