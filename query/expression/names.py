"""Names in criteria: whole names, ``*`` and ``?`` wildcards, ``\\`` escapes, objects and faces.

Names are case-sensitive and matched as a whole. In ``object.face`` the two are split at the last
``.`` that is not escaped; a face part ``#123`` means primitive 123 of the object.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raymap.model.directory import Directory
from raymap.model.errors import UnknownName
from raymap.model.wildcards import Wildcard, characters

__all__ = [
    "PATH_SPECIAL",
    "FaceNames",
    "ObjectMatch",
    "canonical",
    "escape",
    "match_indices",
    "match_objects",
    "nearest_names",
    "split_face",
    "unescape",
]

SPECIAL = "*?.\\#:@()|{}+ ,"
"""Characters that keep their backslash in a canonical pattern."""

_LONGEST, _COMPARED = 200, 4096
"""Characters of a pattern, and names, that are compared for hints."""

PATH_SPECIAL = SPECIAL + '"'
"""Characters that names in path expressions write with a backslash."""


def canonical(pattern: str) -> str:
    """The one spelling of a pattern: backslashes stand before special characters only."""
    out = []
    position = 0
    while position < len(pattern):
        character = pattern[position]
        if character == "\\":
            position += 1
            following = pattern[position] if position < len(pattern) else "\\"
            out.append("\\" + following if following in SPECIAL else following)
        else:
            out.append(character)
        position += 1
    return "".join(out)


def escape(name: str, special: str = "*?.\\#") -> str:
    """Pattern that matches exactly this name."""
    return "".join("\\" + character if character in special else character for character in name)


def unescape(pattern: str) -> str:
    """The name that a pattern without wildcards spells."""
    return "".join(character for character, _ in characters(pattern))


def split_face(pattern: str) -> tuple[str, str | None]:
    """Split ``object.face`` at the last ``.`` that is not escaped."""
    place, split = 0, -1
    for character, escaped in characters(pattern):
        if character == "." and not escaped:
            split = place
        place += 1 + escaped
    return (pattern, None) if split < 0 else (pattern[:split], pattern[split + 1 :])


def nearest_names(pattern: str, names: Iterable[str], count: int = 3) -> list[str]:
    """Names that a person may have meant."""
    wanted = unescape(pattern)
    pool = list(dict.fromkeys(names))
    if len(wanted) > _LONGEST:
        # Nobody mistypes a text of this length, and to compare it takes its square
        return []
    close = difflib.get_close_matches(wanted, pool[:_COMPARED], n=count, cutoff=0.5)
    folded = [name for name in pool if name.lower() == wanted.lower()]
    return list(dict.fromkeys(folded + close))[:count]


def unknown(kind: str, pattern: str, names: Sequence[str]) -> UnknownName:
    """The error of a pattern that matches nothing, with the nearest names."""
    near = nearest_names(pattern, names)
    if near:
        hint = "nearest: " + ", ".join(near)
    elif names:
        shown = ", ".join(names[:8]) + (" …" if len(names) > 8 else "")
        hint = f"the map has: {shown}"
    else:
        hint = f"the map has no {kind}"
    return UnknownName(f'no {kind} of this map is called "{pattern}"; {hint}')


def match_indices(pattern: str, names: Sequence[str], kind: str) -> list[int]:
    """Indices of the names that a pattern matches.

    Raises
    ------
    UnknownName
        the pattern matches nothing.
    """
    wanted = Wildcard(pattern)
    found = [index for index, name in enumerate(names) if wanted.matches(name)]
    # A name that holds signs of wildcards is meant where it stands as it is
    found = found or [index for index, name in enumerate(names) if name == pattern]
    if not found:
        raise unknown(kind, pattern, names)
    return found


class FaceNames:
    """All names by which the faces of a map go, aliases included.

    Attributes
    ----------
    objects : names of the objects, in order
    own_entries : the same without aliases
    entries : (owner's name, face's name, face index) for each face and each alias
    """

    def __init__(self, directory: Directory) -> None:
        self.directory = directory
        self.table = directory.faces
        self.objects = [item.name for item in directory.objects]
        self.entries: list[tuple[str, str, int]] = []
        self.own_entries: list[tuple[str, str, int]] = []
        index = 0
        for item in directory.objects:
            for face in item.faces:
                self.entries.append((item.name, face.name, index))
                self.own_entries.append((item.name, face.name, index))
                for alias in face.aliases:
                    owner, _, name = alias.rpartition(".")
                    self.entries.append((owner, name, index))
                index += 1
        self.n_faces = index

    @property
    def full_names(self) -> list[str]:
        """Objects, then ``object.face`` of every face and alias."""
        return self.objects + [f"{owner}.{name}" for owner, name, _ in self.entries]

    def face_names_of(self, object_pattern: str) -> list[str]:
        """Names of the faces of the matching objects."""
        wanted = Wildcard(object_pattern)
        return [name for owner, name, _ in self.entries if wanted.matches(owner)]


@dataclass(frozen=True, eq=False)
class ObjectMatch:
    """What a name stands for.

    Attributes
    ----------
    objects : (n_objects + 1,) bool, whole objects; the last entry answers for "none"
    faces : (n_faces + 1,) bool, single faces
    triangle : primitive number that is also required, -1 any
    """

    objects: NDArray[np.bool_]
    faces: NDArray[np.bool_]
    triangle: int = -1


def _whole_objects(pattern: str, names: FaceNames, aliases: bool) -> ObjectMatch | None:
    wanted = Wildcard(pattern)
    objects = np.zeros(len(names.objects) + 1, np.bool_)
    faces = np.zeros(names.n_faces + 1, np.bool_)
    for index, name in enumerate(names.objects):
        objects[index] = wanted.matches(name)
    for owner, _, face in names.entries if aliases else ():
        if wanted.matches(owner) and not objects[names.table.object[face]]:
            faces[face] = True
    return ObjectMatch(objects, faces) if objects.any() or faces.any() else None


def _single_faces(
    object_part: str, face_part: str, names: FaceNames, aliases: bool
) -> ObjectMatch | None:
    owners, faces_named = Wildcard(object_part), Wildcard(face_part)
    faces = np.zeros(names.n_faces + 1, np.bool_)
    for owner, name, face in names.entries if aliases else names.own_entries:
        if owners.matches(owner) and faces_named.matches(name):
            faces[face] = True
    if not faces.any():
        return None
    return ObjectMatch(np.zeros(len(names.objects) + 1, np.bool_), faces)


def _is_number(face_part: str) -> bool:
    """Whether it names a primitive: ``#123``."""
    digits = face_part[1:]
    return face_part.startswith("#") and digits.isascii() and digits.isdigit() and len(digits) < 11


def _triangle(object_part: str, number: int, names: FaceNames) -> ObjectMatch | None:
    """Faces that hold primitive ``number`` of a matching object, and the primitive."""
    table = names.table
    owners = Wildcard(object_part)
    faces = np.zeros(names.n_faces + 1, np.bool_)
    wanted = [index for index, name in enumerate(names.objects) if owners.matches(name)]
    inside = (table.first_primitive <= number) & (
        number < table.first_primitive.astype(np.int64) + table.primitive_count
    )
    faces[:-1] = np.isin(table.object, wanted) & inside
    if not faces.any():
        return None
    return ObjectMatch(np.zeros(len(names.objects) + 1, np.bool_), faces, number)


def match_objects(pattern: str, names: FaceNames, *, aliases: bool = True) -> ObjectMatch:
    """Objects, faces or a primitive that a name stands for.

    Without ``aliases`` a shared face goes by the name of its own object only.

    Raises
    ------
    UnknownName
        the pattern matches nothing.
    """
    object_part, face_part = split_face(pattern)
    found: ObjectMatch | None = None
    if face_part is None:
        found = _whole_objects(pattern, names, aliases)
    elif _is_number(face_part):
        found = _triangle(object_part, int(face_part[1:]), names)
        if found is None and _whole_objects(object_part, names, aliases) is not None:
            raise UnknownName(
                f'"{pattern}": {object_part} has no primitive {face_part}; '
                f"primitives are counted from 0"
            )
    else:
        found = _single_faces(object_part, face_part, names, aliases)
    # A name with a dot may be a whole object's; faces come first.
    if found is None and face_part is not None:
        found = _whole_objects(pattern, names, aliases)
    if found is None and not aliases:
        shared = match_objects(pattern, names).faces
        own = ", ".join(names.table.names[face] for face in np.flatnonzero(shared))
        raise UnknownName(
            f'"{pattern}" is the second name of a shared face; here it goes by its own: {own}'
        )
    if found is None:
        if face_part is not None and (known := names.face_names_of(object_part)):
            shown = ", ".join(dict.fromkeys(known))
            raise UnknownName(
                f'no face of this map is called "{pattern}"; faces of {object_part}: {shown}'
            )
        raise unknown("object or face", pattern, names.full_names)
    return found
