"""The markup of the page, one file per part, in the template language of Vue."""

from __future__ import annotations

from pathlib import Path

__all__ = ["template"]


def template(name: str) -> str:
    """The markup of one part."""
    return Path(__file__).with_name(f"{name}.html").read_text(encoding="utf-8")
