"""Criteria to come back to: recent and saved ones, in a small file of the user."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

__all__ = ["CriterionRegistry"]

_REGISTRY_BYTES = 1 << 20


class CriterionRegistry:
    """Recent and saved criteria, in a small file.

    Parameters
    ----------
    path : of the file; None keeps them as long as the application runs
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.recent: list[str] = []
        self.saved: dict[str, str] = {}
        if self.path is None:
            return
        try:
            if self.path.stat().st_size <= _REGISTRY_BYTES:
                stored = json.loads(self.path.read_text(encoding="utf-8"))
                self.recent = [str(text) for text in stored.get("recent", [])][:20]
                self.saved = {str(k): str(v) for k, v in stored.get("saved", {}).items()}
        except (OSError, ValueError, AttributeError):
            pass  # nothing kept yet, or nothing readable: begin afresh

    @classmethod
    def of_user(cls) -> CriterionRegistry:
        """Those of this user, in the configuration folder."""
        base = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
        return cls(Path(base) / "raymap" / "criteria.json")

    @classmethod
    def empty(cls) -> CriterionRegistry:
        """For somebody who is not this user: begins without any, and leaves none behind."""
        return cls(None)

    def use(self, text: str) -> None:
        """Put a criterion on top of the recent ones."""
        if text.strip():
            self.recent = [text, *(other for other in self.recent if other != text)][:20]
            self._write()

    def save(self, name: str, text: str) -> None:
        """Keep a criterion under a name."""
        self.saved[name] = text
        self._write()

    def forget(self, name: str) -> None:
        """Drop a saved criterion."""
        self.saved.pop(name, None)
        self._write()

    def _write(self) -> None:
        if self.path is None:
            return
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            part = self.path.with_suffix(f".{os.getpid()}.part")
            content = {"recent": self.recent, "saved": self.saved}
            part.write_text(json.dumps(content, indent=1, ensure_ascii=False), encoding="utf-8")
            os.replace(part, self.path)
        except OSError:
            pass  # a home that cannot be written loses the list, not the session

    def fields(self) -> dict[str, Any]:
        """For the page."""
        return {
            "recent": self.recent[:10],
            "saved": [{"name": name, "text": text} for name, text in self.saved.items()],
        }
