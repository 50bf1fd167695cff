"""Changes as people write them: ``L5.back.reflectance = 0.5%``.

The last word of a key is what is changed, the rest names faces, objects, surfaces, media or
sources; wildcards are those of criteria.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from query.expression.names import nearest_names
from raymap.laws.lambertian import LambertianLaw
from raymap.laws.law import Law
from raymap.laws.medium import MediumLaw
from raymap.laws.mirror import MirrorLaw
from raymap.laws.radial import RadialScatter
from raymap.laws.smooth import AbsorberLaw, FresnelLaw
from raymap.laws.stack import StackLaw
from raymap.laws.stored import Laws
from raymap.laws.table import TableLaw
from raymap.model.directory import ChannelSet, Directory, Source
from raymap.model.errors import RayMapError, UnknownName
from raymap.model.giventext import toml_tables
from raymap.model.wildcards import Wildcard
from raymap.passes.reweighting import ChangedLaws, MediumChange

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = [
    "Changes",
    "FACE_WORDS",
    "MEDIUM_WORDS",
    "SOURCE_WORDS",
    "changes_of",
    "faces_of",
    "parse_setting",
    "parse_share",
    "step_of",
    "without_laws",
]

Floats = NDArray[np.float64]


def without_laws(map: Any) -> str:
    """Why nothing of a map that states no laws can be changed."""
    if any(medium.kind == "crystal" for medium in map.directory.media):
        return (
            f"{map.path} is of light beside crystals, whose polarisation chose its ways: what its "
            "surfaces and media do cannot be changed after the trace"
        )
    return (
        f"{map.path} does not say what its surfaces and media do to light (it was recorded by an "
        "earlier version or another tracer), so that they cannot be changed; record it again"
    )


_LARGEST = 1e30
"""Largest amount that a change may name: sums of it are numbers."""
FACE_WORDS = (
    "reflectance", "transmittance", "coating", "metal", "black", "lambertian", "scatter",
)  # fmt: skip
MEDIUM_WORDS = ("absorption", "scattering")
SOURCE_WORDS = ("flux", "on", "spectrum")
_BENDS = (
    "index", "refractive_index", "position", "radius", "thickness", "medium", "roughness", "size",
    "rotation", "curvature", "material", "glass",
)  # fmt: skip


def parse_setting(text: str) -> tuple[str, Any]:
    """``KEY=VALUE`` of a command line; values are TOML, or a number with ``%``, or a bare word.

    Raises
    ------
    RayMapError
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise RayMapError(f"--set {text!r}: write NAME.WHAT=VALUE, as L5.back.reflectance=0.5%")
    return key.strip(), _value(value.strip(), text)


def parse_share(text: str, option: str) -> float:
    """A share of light of a command line: ``0.2%`` or ``0.002``.

    Raises
    ------
    RayMapError
    """
    try:
        share = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        raise RayMapError(f"{option} {text!r}: a share is written 0.2% or 0.002") from None
    if not 0.0 <= share <= 1.0:
        raise RayMapError(f"{option} {text!r}: a share lies from 0 to 100%")
    return share


def _value(text: str, whole: str) -> Any:
    if text.endswith("%"):
        try:
            return float(text[:-1]) / 100.0
        except ValueError:
            raise RayMapError(f"--set {whole!r}: {text!r} is no number of percent") from None
    try:
        return toml_tables(f"value = {text}", "--set")["value"]
    except RayMapError:
        raise RayMapError(
            f"--set {_shown(whole)}: the value cannot be read; numbers, 0.5%, true, "
            "[a, b, c] by channel, or a table {key = value}"
        ) from None


@dataclass(frozen=True, eq=False)
class Changes:
    """What is different, resolved to faces, media and sources of a map.

    Attributes
    ----------
    text : as it was written, key and value
    faces, media : how the law of a face or medium is made anew in a channel set, by number
    sources : their new entries
    colors : new shares of light by channel of sources, by number
    """

    text: tuple[tuple[str, Any], ...]
    faces: dict[int, list[Callable[[Law, ChannelSet], Law]]] = field(default_factory=dict)
    media: dict[int, dict[str, Any]] = field(default_factory=dict)
    sources: dict[int, Source] = field(default_factory=dict)
    colors: dict[int, Any] = field(default_factory=dict)

    def laws(
        self, map: RayMap, channel_set: int, earlier: ChangedLaws | None = None
    ) -> ChangedLaws:
        """For the channels of a set of the map.

        Parameters
        ----------
        earlier : changes of the same map on which these come

        Raises
        ------
        RayMapError
            The map states no laws, or values that do not fit its channels.
        """
        channels = map.channel_sets[channel_set]
        before = earlier or ChangedLaws()
        known = map.laws(channel_set) if self.faces or self.media else None
        if (self.faces or self.media) and known is None:
            raise RayMapError(f"{without_laws(map)}; sources can be changed")
        faces, media = dict(before.faces), dict(before.media)
        if known is not None:
            faces.update(self._faces(map.directory, channels, known, before))
            media.update(self._media(map.directory, channels, known, before))
        sources = self._sources(map.directory, channels)
        if sources is None or before.sources is None:
            sources = before.sources if sources is None else sources
        else:
            others = [k for k in range(len(sources)) if k not in self.colors]
            sources[others] = before.sources[others]
        return ChangedLaws(faces=faces, media=media, sources=sources)

    def _faces(
        self, directory: Directory, channels: ChannelSet, known: Laws, before: ChangedLaws
    ) -> dict[int, tuple[Law, Law]]:
        made: dict[tuple[int, int, tuple[int, ...]], tuple[Law, Law]] = {}
        found = {}
        for face, steps in self.faces.items():
            surface = int(directory.faces.surface[face])
            old = known.surfaces[surface] if surface >= 0 else None
            if old is None:
                raise RayMapError(
                    f"the map does not state the law of {directory.faces.names[face]!r}, so that "
                    "it cannot be changed"
                )
            # Faces of one surface share their laws, so that what is evaluated for one serves all
            start = before.faces[face][1] if face in before.faces else old
            key = surface, id(start), tuple(id(step) for step in steps)
            if key not in made:
                new = start
                for step in steps:
                    new = step(new, channels)
                made[key] = old, new
            found[face] = made[key]
        return found

    def _media(
        self, directory: Directory, channels: ChannelSet, known: Laws, before: ChangedLaws
    ) -> dict[int, MediumChange]:
        found = {}
        n = channels.n_channels
        for number, values in self.media.items():
            name = directory.media[number].name
            law = known.media[number] or MediumLaw()
            own = channels.absorption[number] if number < len(channels.absorption) else (0.0,) * n
            absorption = np.asarray(own, np.float64)
            scattering = np.asarray(law.scattering or (0.0,) * n, np.float64)
            now = absorption, scattering
            if number in before.media:
                earlier = before.media[number]
                now = earlier.absorption[1], earlier.scattering[1]
            new_absorption = _by_channel(values.get("absorption", now[0]), n, name)
            new_scattering = _by_channel(values.get("scattering", now[1]), n, name)
            for what, old, new in (
                ("absorbs", absorption, new_absorption),
                ("scatters", scattering, new_scattering),
            ):
                if ((old == 0.0) & (new > 0.0)).any() and what == "scatters":
                    raise RayMapError(
                        f"{name!r} did not scatter when it was recorded, so that no ray shows "
                        "where scattered light would go: record it with a little scattering"
                    )
            found[number] = MediumChange(
                (absorption, new_absorption), (scattering, new_scattering), (law, law)
            )
        return found

    def _sources(self, directory: Directory, channels: ChannelSet) -> Floats | None:
        if not self.colors:
            return None
        own = np.asarray(channels.source_colors, np.float64)
        n = channels.n_channels
        if own.shape != (len(directory.sources), n):
            raise RayMapError("the map does not state the colours of its sources")
        ratios = np.ones(own.shape)
        for number, values in self.colors.items():
            name = directory.sources[number].name
            shares = _by_channel(values, n, name)
            if not shares.sum() > 0.0:
                raise RayMapError(f"the spectrum of {name!r} is dark in every channel")
            shares = shares / shares.sum()
            missing = (own[number] == 0.0) & (shares > 0.0)
            if missing.any():
                dark = channels.labels[int(missing.argmax())]
                raise RayMapError(
                    f"{name!r} emitted no light of {dark} when it was recorded, so that no ray "
                    "shows where that would go"
                )
            ratios[number] = np.divide(
                shares, own[number], out=np.zeros(n), where=own[number] > 0.0
            )
        return ratios


def changes_of(map: RayMap, given: Mapping[str, Any]) -> Changes:
    """Resolve changes against the names of a map.

    Raises
    ------
    UnknownName, RayMapError
        There is no such face, medium or source; a word that bends light elsewhere; values that
        reflect and transmit more than 1.
    """
    changes = Changes(tuple(given.items()))
    for key, value in given.items():
        pattern, _, word = key.rpartition(".")
        if word in SOURCE_WORDS and pattern:
            _change_sources(changes, map.directory, pattern, word, value)
        elif word in MEDIUM_WORDS and pattern:
            for number in _matching(pattern, [m.name for m in map.directory.media], "medium"):
                changes.media.setdefault(number, {})[word] = value
        elif word in FACE_WORDS and pattern:
            step = step_of(key, word, value, map)
            for face in faces_of(map.directory, pattern):
                changes.faces.setdefault(face, []).append(step)
        elif word in _BENDS:
            raise RayMapError(
                f"{key}: a change of {word!r} bends light elsewhere; only a new trace shows that"
            )
        else:
            known = (*FACE_WORDS, *MEDIUM_WORDS, *SOURCE_WORDS)
            near = nearest_names(word, known)
            hint = f"; nearest: {', '.join(near)}" if near else ""
            raise RayMapError(
                f"{key}: {word!r} is nothing that can be changed after the trace{hint}; "
                f"faces: {', '.join(FACE_WORDS)}; media: {', '.join(MEDIUM_WORDS)}; sources: "
                f"{', '.join(SOURCE_WORDS)}"
            )
    return changes


def _matching(pattern: str, names: list[str], kind: str) -> list[int]:
    from query.expression.names import match_indices

    return match_indices(pattern, names, kind)


def faces_of(directory: Directory, pattern: str) -> list[int]:
    """Faces by their own name, by that of their object, or of their surface."""
    faces = directory.faces
    wild = Wildcard(pattern)
    found = [
        face
        for face, name in enumerate(faces.names)
        if wild.matches(name) or wild.matches(faces.object_names[faces.object[face]])
    ]
    for face, aliases in _aliases(directory):
        if any(wild.matches(alias) for alias in aliases) and face not in found:
            found.append(face)
    if not found:
        surfaces = {k for k, s in enumerate(directory.surfaces) if wild.matches(s.name)}
        found = [face for face, own in enumerate(faces.surface.tolist()) if own in surfaces]
    if not found:
        near = nearest_names(
            pattern,
            (*faces.names, *faces.object_names, *(entry.name for entry in directory.surfaces)),
        )
        raise UnknownName(
            f"no face, object or surface is called {pattern!r}"
            + (f"; nearest: {', '.join(near)}" if near else "")
        )
    return sorted(found)


def _aliases(directory: Directory) -> list[tuple[int, tuple[str, ...]]]:
    faces = directory.faces
    found = []
    for number, entry in enumerate(directory.objects):
        first = int(faces.first_face[number])
        found += [
            (first + k, tuple(face.aliases)) for k, face in enumerate(entry.faces) if face.aliases
        ]
    return found


def _change_sources(
    changes: Changes, directory: Directory, pattern: str, word: str, value: Any
) -> None:
    for number in _matching(pattern, [s.name for s in directory.sources], "source"):
        source = changes.sources.get(number, directory.sources[number])
        if word == "spectrum":
            changes.colors[number] = value
            continue
        if word == "on":
            if not isinstance(value, bool):
                raise RayMapError(f"{pattern}.on: true or false, not {value!r}")
            flux = source.flux if value else 0.0
        else:
            flux = _number(value, f"{pattern}.flux")
            if flux < 0.0:
                raise RayMapError(f"{pattern}.flux: a flux is not negative, {flux:g} was given")
        changes.sources[number] = source.model_copy(update={"flux": flux})


def _number(value: Any, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RayMapError(f"{key}: a number is needed, not {value!r}")
    try:
        number = float(value)
    except OverflowError:
        number = np.inf
    if not abs(number) <= _LARGEST:
        raise RayMapError(f"{key}: {_shown(value)} is no amount that can be summed")
    return number


def _shown(value: Any) -> str:
    text = str(value) if isinstance(value, float) else repr(value)[:40]
    return text if len(text) < 40 else f"{text[:37]}..."


def _by_channel(value: Any, n: int, key: str) -> Floats:
    """(n,) one value for all channels, or one for each."""
    try:
        values = np.atleast_1d(np.asarray(value, np.float64))
    except (TypeError, ValueError, OverflowError):
        raise RayMapError(f"{key}: numbers are needed, not {_shown(value)}") from None
    if values.ndim != 1 or len(values) not in (1, n):
        raise RayMapError(f"{key}: {len(values)} values were given, the map has {n} channels")
    if not (values <= _LARGEST).all() or (values < 0.0).any():
        raise RayMapError(f"{key}: values are numbers from 0 to {_LARGEST:g}, not {_shown(value)}")
    return np.broadcast_to(values, n).astype(np.float64)


def _shares(value: Any, n: int, key: str) -> tuple[float, ...]:
    shares = _by_channel(value, n, key)
    if (shares > 1.0).any():
        raise RayMapError(f"{key}: a share of light is at most 1, not {value!r}")
    return tuple(shares.tolist())


def step_of(key: str, word: str, value: Any, map: RayMap) -> Callable[[Law, ChannelSet], Law]:
    """How a law becomes the changed one; the value is checked when the channels are known."""

    def step(old: Law, channels: ChannelSet) -> Law:
        try:
            made: Law = _MAKERS[word](key, value, old, channels, map)
            return made
        except ValidationError as error:
            problem = error.errors()[0]
            place = ".".join(str(part) for part in problem["loc"])
            raise RayMapError(f"{key}: {place + ': ' if place else ''}{problem['msg']}") from None

    return step


def _reflectance(key: str, value: Any, old: Law, channels: ChannelSet, map: RayMap) -> Law:
    shares = _shares(value, channels.n_channels, key)
    if isinstance(old, LambertianLaw):
        return _lambertian_of(key, shares, old.transmittance)
    if isinstance(old, MirrorLaw):
        return MirrorLaw(reflectance=shares, roughness=old.roughness, scatter=old.scatter)
    if isinstance(old, FresnelLaw | TableLaw | StackLaw) and type(old).__name__ != "RoughLaw":
        through = tuple((1.0 - share,) for share in shares)
        back = tuple((share,) for share in shares)
        return TableLaw(
            angle_deg=(0.0,), reflectance=back, transmittance=through, scatter=old.scatter
        )
    raise RayMapError(
        f"{key}: the law {old.law!r} has no reflectance of its own; use lambertian, metal, coating "
        "or black"
    )


def _lambertian_of(key: str, back: tuple[float, ...], through: tuple[float, ...]) -> Law:
    if any(r + t > 1.0 for r, t in zip(back, through, strict=False)):
        raise RayMapError(f"{key}: reflectance and transmittance together exceed 1")
    return LambertianLaw(reflectance=back, transmittance=through)


def _transmittance(key: str, value: Any, old: Law, channels: ChannelSet, map: RayMap) -> Law:
    shares = _shares(value, channels.n_channels, key)
    if isinstance(old, LambertianLaw):
        return _lambertian_of(key, old.reflectance, shares)
    if isinstance(old, TableLaw):
        through = tuple((share,) * len(old.angle_deg) for share in shares)
        return TableLaw(
            angle_deg=old.angle_deg, reflectance=old.reflectance, transmittance=through,
            scatter=old.scatter,
        )  # fmt: skip
    raise RayMapError(
        f"{key}: the law {old.law!r} has no transmittance of its own; set the reflectance, or a "
        "coating = {angle_deg, reflectance, transmittance}"
    )


def _lambertian(key: str, value: Any, old: Law, channels: ChannelSet, map: RayMap) -> Law:
    return LambertianLaw(reflectance=_shares(value, channels.n_channels, key))


def _black(key: str, value: Any, old: Law, channels: ChannelSet, map: RayMap) -> Law:
    if value is not True:
        raise RayMapError(f"{key}: true is the only value; leave it out to keep the surface")
    return AbsorberLaw()


def _metal(key: str, value: Any, old: Law, channels: ChannelSet, map: RayMap) -> Law:
    if not isinstance(value, dict) or set(value) != {"n", "k"}:
        raise RayMapError(f"{key}: write {{n = ..., k = ...}}, numbers or one for each channel")
    n, k = (
        tuple(_by_channel(value[name], channels.n_channels, key).tolist()) for name in ("n", "k")
    )
    return MirrorLaw(n=n, k=k)


def _scatter(key: str, value: Any, old: Law, channels: ChannelSet, map: RayMap) -> Law:
    if "scatter" not in type(old).model_fields:
        raise RayMapError(f"{key}: the law {old.law!r} has no scatter about specular light")
    if getattr(old, "scatter", None) is None:
        raise RayMapError(
            f"{key}: the surface did not scatter when it was recorded, so that no ray shows where "
            "scattered light would go: record it with a little scatter"
        )
    scatter = RadialScatter.model_validate(value)
    law: Law = type(old).model_validate({**old.model_dump(), "scatter": scatter})
    return law


def _coating(key: str, value: Any, old: Law, channels: ChannelSet, map: RayMap) -> Law:
    if not isinstance(old, FresnelLaw | TableLaw | StackLaw):
        raise RayMapError(f"{key}: the law {old.law!r} is not that of an interface")
    if not isinstance(value, dict):
        raise RayMapError(
            f"{key}: write {{between = [MEDIUM, MEDIUM], layers = [{{thickness_nm, index}}, ...]}} "
            "or {angle_deg, reflectance, transmittance}"
        )
    n = channels.n_channels
    if "layers" in value:
        if not isinstance(value["layers"], list) or not all(
            isinstance(layer, dict) for layer in value["layers"]
        ):
            raise RayMapError(f"{key}: layers = [{{index = ..., thickness_nm = ...}}, ...]")
        layers = [
            {
                "thickness_nm": layer.get("thickness_nm"),
                "n": tuple(_by_channel(layer.get("index"), n, f"{key}: index").tolist()),
                "k": tuple(
                    _by_channel(layer.get("extinction", 0.0), n, f"{key}: extinction").tolist()
                ),
            }
            for layer in value["layers"]
        ]
        names = [medium.name for medium in map.directory.media]
        between = value.get("between")
        if not isinstance(between, list) or len(between) != 2:
            raise RayMapError(f"{key}: between = [MEDIUM, MEDIUM] says where the layers begin")
        numbers = [_matching(str(name), names, "medium")[0] for name in between]
        law: Law = StackLaw.model_validate(
            {"between": numbers, "layers": layers, "scatter": old.scatter}
        )
        return law
    rows = {}
    for name in ("reflectance", "transmittance"):
        given = value.get(name)
        nested = isinstance(given, list) and given and isinstance(given[0], list)
        rows[name] = given if nested else [given] * n
    table: Law = TableLaw.model_validate(
        {"angle_deg": value.get("angle_deg"), "scatter": old.scatter, **rows}
    )
    return table


_MAKERS: dict[str, Any] = {
    "reflectance": _reflectance,
    "transmittance": _transmittance,
    "lambertian": _lambertian,
    "black": _black,
    "metal": _metal,
    "scatter": _scatter,
    "coating": _coating,
}
