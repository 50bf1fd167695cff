"""The commands that ask a map."""

from __future__ import annotations

from query.cli.questions import register

__all__ = ["register"]
