"""The laws of a map: what it says of its surfaces and media in the channels of a channel set.

They stand under the key ``laws`` of a channel set. A map without it (of an earlier version, of a
tracer that does not say) has none, and a surface whose law is null has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from raymap.laws.lambertian import LambertianLaw
from raymap.laws.law import Law
from raymap.laws.medium import MediumLaw
from raymap.laws.mirror import MirrorLaw
from raymap.laws.retroreflector import RetroreflectorLaw
from raymap.laws.rough import RoughLaw
from raymap.laws.sheet import FilterLaw, PolariserLaw, RetarderLaw
from raymap.laws.smooth import AbsorberLaw, FresnelLaw
from raymap.laws.stack import StackLaw
from raymap.laws.table import TableLaw
from raymap.laws.tabulated import TabulatedLaw
from raymap.model.directory import ChannelSet, Directory
from raymap.model.errors import FormatError

__all__ = ["FORMS", "Laws", "laws_of", "stored_laws"]

FORMS: dict[str, type[Law]] = {
    form.model_fields["law"].default: form
    for form in (
        AbsorberLaw,
        FilterLaw,
        FresnelLaw,
        LambertianLaw,
        MirrorLaw,
        PolariserLaw,
        RetarderLaw,
        RetroreflectorLaw,
        RoughLaw,
        StackLaw,
        TableLaw,
        TabulatedLaw,
    )
}
"""The forms of laws of surfaces, by name."""


@dataclass(frozen=True, kw_only=True)
class Laws:
    """Laws by number of surface and of medium; None where the map does not say."""

    surfaces: tuple[Law | None, ...]
    media: tuple[MediumLaw | None, ...]


def stored_laws(
    surfaces: Sequence[Law | None], media: Sequence[MediumLaw | None]
) -> dict[str, Any]:
    """JSON for the key ``laws`` of a channel set."""
    return {
        "surfaces": [_plain(law, {"law"}) for law in surfaces],
        "media": [_plain(law, set()) for law in media],
    }


def _plain(law: Any, always: set[str]) -> dict[str, Any] | None:
    if law is None:
        return None
    said: dict[str, Any] = law.model_dump(mode="json", exclude_defaults=True)
    return {**{key: getattr(law, key) for key in always}, **said}


def laws_of(directory: Directory, channel_set: ChannelSet) -> Laws | None:
    """What a map says of its laws; None where it says nothing.

    Forms that this version does not know are None, as if the map did not say.

    Raises
    ------
    FormatError
        They are not sound: of other surfaces, media or channels than the map has.
    """
    given = channel_set.laws
    if not given:
        return None
    for key, entries in (("surfaces", directory.surfaces), ("media", directory.media)):
        stated = given.get(key)
        if not isinstance(stated, list) or len(stated) != len(entries):
            raise FormatError(
                f"the laws of the map are not those of its {len(entries)} {key}: the file was "
                "damaged or made up; without laws, all other questions can still be asked"
            )
    surfaces = tuple(
        _parsed(_form(values), values, f"surface {entry.name!r}", channel_set)
        for entry, values in zip(directory.surfaces, given["surfaces"], strict=True)
    )
    media = tuple(
        _parsed(MediumLaw, values, f"medium {entry.name!r}", channel_set)
        for entry, values in zip(directory.media, given["media"], strict=True)
    )
    known = range(min(len(directory.media), len(channel_set.refractive_index)))
    for law, entry in zip(surfaces, directory.surfaces, strict=True):
        if isinstance(law, StackLaw) and not set(law.between) <= set(known):
            raise FormatError(
                f"the law of surface {entry.name!r} lies between media that the map does not have"
            )
    return Laws(surfaces=surfaces, media=media)


def _form(values: Any) -> type[Law] | None:
    return FORMS.get(str(values.get("law"))) if isinstance(values, dict) else None


def _parsed(form: Any, values: Any, whose: str, channel_set: ChannelSet) -> Any:
    if values is None or form is None:
        return None
    try:
        law = form.model_validate(values)
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(str(part) for part in problem["loc"])
        raise FormatError(f"the law of {whose} is not sound: {where}: {problem['msg']}") from None
    _check_channels(law, whose, channel_set.n_channels)
    return law


def _check_channels(law: Any, whose: str, n_channels: int) -> None:
    """Refuse numbers by channel of other channels."""
    fields = type(law).model_fields
    names = [name for name in _BY_CHANNEL if name in fields]
    rows = [(getattr(law, name), fields[name].is_required()) for name in names]
    for layer in getattr(law, "layers", ()):
        rows += [(layer.n, True), (layer.k, False)]
    if any((row or needed) and len(row) != n_channels for row, needed in rows):
        raise FormatError(f"the law of {whose} has other channels than the {n_channels} of the map")


_BY_CHANNEL = (
    "reflectance",
    "transmittance",
    "reflectance_s",
    "transmittance_s",
    "retardance_nm",
    "n",
    "k",
    "scattering",
    "group_index",
)
