"""What a scene of the served folder may read: copies of files inside, in a private folder.

Readers of meshes, CAD and pictures are many, some are foreign, and a link can be swapped between a
look and an opening. So none of them is handed a path of the served folder. Each file that a scene
names is opened once from the folder that is held open, copied, and read from the copy.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from raymap.model.errors import SceneError
from service.files.bounds import permitted
from service.files.confine import OutsideFolder, ServedFolder

__all__ = ["SceneMirror"]


class SceneMirror:
    """The door for the files of one scene (`tracer.description.named_files.Door`).

    Parameters
    ----------
    folder : the served folder
    place : an empty private folder, for the copies
    most_bytes : that all of them together may have
    """

    def __init__(self, folder: ServedFolder, path: Path, most_bytes: int) -> None:
        self.folder, self.place, self.most = folder, Path(os.path.realpath(path)), most_bytes
        self._taken: dict[Path, Path] = {}
        self._bytes = 0

    def __call__(self, path: Path) -> Path:
        """Where the copy of a file lies; where it would lie, if there is no such file.

        Raises
        ------
        OutsideFolder
            The path leads outside, over a link, or to what is hidden or no file.
        SceneError
            The files of the scene are too large together.
        """
        copy = Path(os.path.normpath(path))
        shown = str(path).removeprefix(f"{self.place}{os.sep}")
        name = self._name(copy, shown)
        if name not in self._taken:
            self._taken[name] = self._copied(name, shown)
        return self._taken[name]

    def plain(self, text: str) -> str:
        """A message without the places of this machine."""
        return self.folder.plain(text.replace(f"{self.place}{os.sep}", "").replace(
            str(self.place), "."))  # fmt: skip

    def _name(self, path: Path, shown: str) -> Path:
        """The file's name relative to the served folder."""
        for root in (self.place, self.folder.root):
            if root in path.parents:
                return path.relative_to(root)
        raise _outside(shown)

    def _copied(self, name: Path, shown: str) -> Path:
        try:
            found = self.folder.path(name.as_posix())
        except OutsideFolder:
            raise _outside(shown) from None
        copy = self.place / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        try:
            with permitted():
                descriptor = self.folder.open(found)
            with open(descriptor, "rb") as source:
                self._bytes += os.fstat(source.fileno()).st_size
                if self._bytes > self.most:
                    raise SceneError(
                        f"{shown}: the files of the scene have more than the {self.most} bytes "
                        "that this service reads"
                    )
                with copy.open("xb") as target:
                    shutil.copyfileobj(source, target, 2**20)
        except FileNotFoundError:
            pass
        except OutsideFolder:
            raise _outside(shown) from None
        except OSError as error:
            raise SceneError(f"{shown} cannot be read: {error.strerror}") from None
        return copy


def _outside(shown: str) -> OutsideFolder:
    name = shown if len(shown) <= 200 else shown[:200] + "…"
    return OutsideFolder(f"{name!r} is outside the served folder; put the file into it")
