"""The lens as one primitive: a ray goes in, all its outgoing rays come out."""

from __future__ import annotations

from tracer.lens.backward import Arriving, Bundle, answer, trace_backward
from tracer.lens.errors import LensError
from tracer.lens.forward import trace_lens, trace_rgb
from tracer.lens.glass import Glass
from tracer.lens.lens import Lens
from tracer.lens.tree import Exits, LensTree

__all__ = [
    "Arriving",
    "Bundle",
    "Exits",
    "Glass",
    "Lens",
    "LensError",
    "LensTree",
    "answer",
    "trace_backward",
    "trace_lens",
    "trace_rgb",
]
