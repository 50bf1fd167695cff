"""A process in which some of our packages cannot be imported, as if their folders were deleted.

``python -m tests.without tracer.lens,tracer.render raymap check scene.toml`` runs the command
``raymap``, ``python -m tests.without tracer pytest tests/query`` the tests of a room.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

__all__ = ["leave_out"]


class _Without:
    """A finder of modules that does not find some."""

    def __init__(self, finder: Any, names: Sequence[str]) -> None:
        self.finder, self.names = finder, tuple(names)

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if any(name == each or name.startswith(f"{each}.") for each in self.names):
            return None
        found: ModuleSpec | None = self.finder.find_spec(name, path, target)
        return found

    def __getattr__(self, name: str) -> Any:
        return getattr(self.finder, name)


def leave_out(names: Sequence[str]) -> None:
    """From now on these packages and all in them are not there.

    Raises
    ------
    RuntimeError
        one of them has been imported
    """
    known = [name for name in sys.modules if any(f"{name}.".startswith(f"{n}.") for n in names)]
    if known:
        raise RuntimeError(f"{', '.join(known)} are imported already")
    finders: list[Any] = [_Without(each, names) for each in sys.meta_path]
    sys.meta_path[:] = finders


if __name__ == "__main__":
    leave_out(sys.argv[1].split(","))
    sys.argv[:] = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
