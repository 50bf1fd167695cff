"""One thing that was looked at."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Finding"]


@dataclass(frozen=True)
class Finding:
    """What was found, and what is wrong with it.

    Attributes
    ----------
    part : of the installation
    found : in one line
    problem, remedy : what is wrong and what to do; empty where nothing is
    """

    part: str
    found: str
    problem: str = ""
    remedy: str = ""
