"""Shared set-up of the tests.

Compiled functions are cached on disk. Numba notices an edit of the function itself, not of a
function that it calls, so the cache directory is named by a hash of all sources.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent


def _source_hash() -> str:
    digest = hashlib.sha256()
    for room in ("raymap", "tracer", "query", "viewer", "service", "tests"):
        for source in sorted((_ROOT / room).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


os.environ.setdefault(
    "NUMBA_CACHE_DIR", str(Path(tempfile.gettempdir()) / f"raymap-tests-{_source_hash()}")
)
os.environ.setdefault("MPLBACKEND", "Agg")
