"""What a token may do: one table of the rights that actions and streams need."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from raymap.model.errors import RayMapError
from service.files.confine import ServedFolder

__all__ = ["ANY", "EVERYTHING", "NEEDS", "RIGHTS", "Grant", "NotAllowed", "read_rights"]

ANY = ""
"""Any token will do."""

RIGHTS = {
    "ask": "ask maps, and look at them in the application",
    "record": "read scenes and record new maps",
    "write": "upload files; replace maps, or add to them",
}

NEEDS = {
    "list_actions": ANY,
    "hello": ANY,
    "files": "ask",
    "scene": "record",
    "record": "record",
    "describe": "ask",
    "criterion": "ask",
    "count": "ask",
    "report": "ask",
    "view": "ask",
    "drawn": "ask",
    "close_view": "ask",
    "rays": "ask",
    "ray_ids": "ask",
    "lines": "ask",
    "paths": "ask",
    "image": "ask",
    "picture": "ask",
    "list_flights": "ask",
    "upload": "write",
}
"""The right that each action, stream and other call needs; what stands not here is refused."""

_CHANGES = ("force", "append")
"""Keys of ``record`` that change a map that is there: they need ``write`` besides."""


class NotAllowed(RayMapError, PermissionError):
    """A token without the right that a call needs."""


@dataclass(frozen=True, kw_only=True)
class Grant:
    """What one token allows.

    Attributes
    ----------
    name : of the token, for people
    rights : keys of `RIGHTS`
    maps : the only maps that it reaches, as clients name them; None for all of the folder
    expires : end of its time [s since 1970]; None for never
    """

    name: str
    rights: frozenset[str]
    maps: tuple[str, ...] | None = None
    expires: float | None = None

    def check(self, call: str, fields: dict[str, object], folder: ServedFolder) -> None:
        """Refuse a call that it does not allow.

        Parameters
        ----------
        call : key of `NEEDS`
        fields : of the request
        folder : in which the request's names are looked up

        Raises
        ------
        NotAllowed, OutsideFolder
        """
        need = NEEDS.get(call)
        if need is None:
            raise NotAllowed(f"no token allows {call[:40]!r}")
        if need != ANY:
            self._need(need, call)
        if call == "record" and any(fields.get(key) for key in _CHANGES):
            self._need("write", "record with 'force' or 'append'")
        name = fields.get("map")
        if self.maps is not None and isinstance(name, str) and not self.reaches(name, folder):
            raise NotAllowed(
                f"{call}: this token does not reach {name[:200]!r}, only {', '.join(self.maps)}"
            )

    def reaches(self, name: str, folder: ServedFolder) -> bool:
        """Whether a map may be asked; links are followed first, so none stands for another."""
        return self.maps is None or folder.shown(folder.path(name)) in self.maps

    def _need(self, right: str, call: str) -> None:
        if right not in self.rights:
            raise NotAllowed(
                f"{call} needs a token with the right {right!r}; this one has "
                f"{', '.join(sorted(self.rights)) or 'none'}"
            )


EVERYTHING = Grant(name="", rights=frozenset(RIGHTS))
"""What the one token of ``raymap serve`` allows."""


def read_rights(words: Iterable[str]) -> frozenset[str]:
    """Rights by their names.

    Raises
    ------
    RayMapError
        One does not exist, or none is given.
    """
    rights = frozenset(word.strip() for word in words)
    if not rights or not rights <= set(RIGHTS):
        wrong = ", ".join(sorted(map(repr, rights - set(RIGHTS)))) or "nothing"
        raise RayMapError(f"a token has one or more of the rights {', '.join(RIGHTS)}, not {wrong}")
    return rights
