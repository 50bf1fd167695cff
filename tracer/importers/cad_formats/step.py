"""STEP: solids in closed form or as triangles; OpenCASCADE is loaded when a file is read."""

from __future__ import annotations

from tracer.importers.cad_format import CadFormat
from tracer.importers.cad_formats.step_read import read_step

__all__ = ["KINDS"]

KINDS = (
    CadFormat(
        suffixes=(".step", ".stp", ".p21"),
        title="solids of STEP, with names and colours",
        place=10,
        sniff=lambda head: head.lstrip().startswith(b"ISO-10303-21"),
        read=read_step,
    ),
)
