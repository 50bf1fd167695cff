"""Files of other programs in scenes: tables that name them, and files that are scenes themselves.

Importers stand above scenes, so they register (entry-point group ``tracer.scene_files``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from raymap.model.registry import Registry

__all__ = ["FILE_TABLES", "FileTable", "scene_suffixes", "table_of_bodies", "table_of_scene_file"]


@dataclass(frozen=True, kw_only=True)
class FileTable:
    """A table ``[NAME.X]`` of a scene file whose entries name files of other programs.

    Attributes
    ----------
    name : the table's
    title : what its entries name
    model : what an entry may say
    merge : adds to the tables of a scene what an entry's file holds; takes the tables, the entry's
        name and model, the scene's folder, and the scene's name for messages
    scene_suffixes : of files that are scenes on their own, or are refused with what they are
    scene_text : such a file as the text of a scene
    body_suffixes : of files that a table takes, which are no scenes
    """

    name: str
    title: str
    model: type[BaseModel]
    merge: Callable[[dict[str, Any], str, Any, Path, str], None]
    scene_suffixes: tuple[str, ...] = ()
    scene_text: Callable[[Path], str] | None = None

    def spelling(self) -> str:
        """How it is written in a scene."""
        return f"[{self.name}.NAME]"

    body_suffixes: tuple[str, ...] = ()


FILE_TABLES: Registry[FileTable] = Registry(
    "tracer.scene_files",
    "",
    words=lambda table: (table.name,),
    of=FileTable,
    sort="tables that name files of other programs",
)


def scene_suffixes() -> tuple[str, ...]:
    """Suffixes of files that are scenes on their own, or are refused with what they are."""
    return tuple(suffix for table in FILE_TABLES.values() for suffix in table.scene_suffixes)


def table_of_scene_file(path: Path) -> FileTable | None:
    """What takes a file as a scene; None where nothing does."""
    wanted = path.suffix.lower()
    found = (table for table in FILE_TABLES.values() if wanted in table.scene_suffixes)
    return next(found, None)


def table_of_bodies(path: Path) -> FileTable | None:
    """What takes a file into a scene that is none itself; None where nothing does."""
    wanted = path.suffix.lower()
    found = (table for table in FILE_TABLES.values() if wanted in table.body_suffixes)
    return next(found, None)
