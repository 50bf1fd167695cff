"""Read sequential lens files of CODE V (``.seq``)."""

from __future__ import annotations

from pathlib import Path

from tracer.importers.prescription import Prescription

__all__ = ["read_codev"]


def read_codev(path: str | Path) -> Prescription:
    raise NotImplementedError
