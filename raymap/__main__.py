"""``python -m raymap``: the command, where the environment's scripts are not on the path."""

from __future__ import annotations

from raymap.cli import main

if __name__ == "__main__":
    main()
