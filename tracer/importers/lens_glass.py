"""Glasses of lens files as media of a scene: the makers' catalogues, the file's own, or a twin.

Programs write names in their own ways (NBK7_SCHOTT, SILICA, L-TIM28_MOLD). A name that only means
another glass is taken for it, with a warning that says so.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib import util
from typing import Any

from raymap.model.errors import MissingExtra, SceneError
from tracer.importers.prescription import GlassName, ImportWarning
from tracer.optics.dispersion import LINE_NM, OutOfRangeWarning
from tracer.optics.glasses import MAKERS, Glass, find_glass, find_shipped
from tracer.optics.maker_glasses import loose_key, similar_rows

__all__ = ["medium_of_glass"]

_MATERIALS = {
    "silica": "fused silica", "fsilica": "fused silica", "fusedsilica": "fused silica",
    "quartz": "quartz o", "quartze": "quartz e", "calcite": "calcite o", "calcitee": "calcite e",
    "sapphire": "sapphire o", "sapphiree": "sapphire e", "al2o3": "sapphire o",
    "mgf2": "MgF2 o", "mgf2e": "MgF2 e", "caf2": "CaF2", "baf2": "barium fluoride",
    "srf2": "strontium fluoride", "lif": "lithium fluoride", "naf": "sodium fluoride",
    "nacl": "sodium chloride", "kcl": "potassium chloride", "kbr": "potassium bromide",
    "csbr": "caesium bromide", "csi": "caesium iodide", "germanium": "germanium",
    "ge": "germanium", "gelong": "germanium", "geold": "germanium", "germmw": "germanium",
    "germlw": "germanium", "silicon": "silicon", "si": "silicon", "gaas": "gallium arsenide",
    "zns": "zinc sulfide", "znsir": "zinc sulfide", "znsvis": "zinc sulfide",
    "znsbroad": "zinc sulfide", "cleartran": "zinc sulfide", "znse": "ZnSe",
    "acrylic": "PMMA", "pmma": "PMMA", "polycarb": "polycarbonate", "pc": "polycarbonate",
    "polystyr": "polystyrene", "styrene": "polystyrene", "san": "SAN", "e48r": "COP",
    "water": "water", "h2o": "water", "seawater": "seawater", "diamond": "diamond",
}  # fmt: skip
"""Crystals, plastics and liquids, which no maker owns, as design programs write them."""

_OF_MATERIALS = ("infrared", "misc", "special", "birefringent", "heraeus", "corning", "liquids")
"""Catalogues of them, by the start of their names."""

_LIKE = 2e-3
"""Largest difference of the index at the d line between what is taken for one material."""


def medium_of_glass(
    glass: GlassName,
    *,
    makers: tuple[str, ...] = (),
    given: Mapping[str, str] | None = None,
    where: str = "",
) -> tuple[str, dict[str, Any]]:
    """A name for the medium, and its table in a scene (empty: the scene has that medium itself).

    Parameters
    ----------
    makers : catalogues in the order in which the file looks glasses up
    given : what the user says that a name means: another glass, or a medium of the scene ("": the
        scene has a medium of this very name)
    where : file and surface, for messages

    Raises
    ------
    SceneError
        where nobody knows the glass, or several know different ones; it names them and says what
        to do
    """
    if given and glass.name in given:
        meant = given[glass.name]
        if not meant:
            return glass.name, {}
        found = find_shipped(meant) or _look_further(meant)
        return (meant, {"glass": _full_name(found)}) if found else (meant, {})
    if glass.model is not None:
        return _model(*glass.model)
    if glass.table:
        pairs = sorted(glass.table)
        if len(pairs) == 1:
            return glass.name, {"index": pairs[0][1]}
        return glass.name, {
            "index": {
                "wavelength_nm": [pair[0] for pair in pairs],
                "value": [pair[1] for pair in pairs],
            }
        }
    catalogues = tuple(name for name in (glass.maker, *makers) if name)
    found = _chosen(glass, catalogues, where)
    if found is None:
        for twin, why in _twins(glass.name):
            found = _in_catalogues(twin, catalogues) or find_shipped(twin)
            if found is not None:
                _warn(f"{where}: glass {glass.name!r} is taken for {_full_name(found)}: {why}")
                break
    found = found or _look_further(glass.name)
    code = re.fullmatch(r"(\d{3})(\d{3})", glass.name)
    if found is None and glass.said is None and code:
        glass = replace(glass, said=(1.0 + int(code[1]) / 1000.0, int(code[2]) / 10.0))
    if found is None and glass.said is not None and glass.said[0] > 1.0:
        index, abbe = glass.said
        _warn(
            f"{where}: no catalogue has the glass {glass.name!r}; it is taken for a model glass of "
            f"index {index:g} and Abbe number {abbe:g}, which the file gives"
        )
        return _model(index, abbe)
    if found is None:
        near = similar_rows(glass.name)
        names = f"; the nearest names are {', '.join(near)}" if near else ""
        more = "" if util.find_spec("opticalglass") else _EXTRA
        raise SceneError(
            f"{where}: no catalogue has the glass {glass.name!r}{names}; name what to take in a "
            f'scene file: [lens_files.NAME] with glasses = {{ "{glass.name}" = "N-BK7" }}, '
            f'or give it as [media."{glass.name}"]{more}'
        )
    return found.name, {"glass": _full_name(found)}


_EXTRA = "; the makers' newest glasses come with pip install opticalglass"


def _warn(message: str) -> None:
    warnings.warn(message, ImportWarning, stacklevel=2)


def _model(index: float, abbe: float) -> tuple[str, dict[str, Any]]:
    return f"glass {index:.5g} {abbe:.4g}", {"cauchy": _cauchy(index, abbe)}


def _chosen(glass: GlassName, catalogues: tuple[str, ...], where: str) -> Glass | None:
    """The glass that a name means in a file of these catalogues; None where none has it."""
    listed = _in_catalogues(glass.name, catalogues)
    known = _everywhere(glass.name)
    if listed is not None and not _differs(listed, glass.said):
        return listed
    said = [other for other in known if glass.said and _agrees(other, glass.said)]
    if listed is not None or said:
        found = said[0] if said else listed
        assert found is not None
        if not said and glass.said is not None:
            _warn(
                f"{where}: {_full_name(found)} has the index {_at_d(found):.5f} at 587.6 nm, the "
                f"file gives {glass.said[0]:g} for {glass.name!r}; the catalogue's is taken"
            )
        elif catalogues and listed is None:
            _warn(f"{where}: glass {glass.name!r} is taken for {_full_name(found)}, by its index")
        return found
    if not known:
        return None
    if any(abs(_at_d(other) - _at_d(known[0])) > _LIKE for other in known[1:]):
        names = ", ".join(f"{_full_name(other)} ({_at_d(other):.4f})" for other in known)
        raise SceneError(
            f"{where}: the glass {glass.name!r} may be {names}, and no catalogue that the file "
            "names decides; say which in a scene file: [lens_files.NAME] with glasses = "
            f'{{ "{glass.name}" = "{_full_name(known[0])}" }}'
        )
    if catalogues and known[0].maker:
        _warn(
            f"{where}: glass {glass.name!r} is taken from {known[0].maker}; the catalogues of the "
            f"file ({', '.join(catalogues)}) do not have it"
        )
    return known[0]


def _differs(glass: Glass, said: tuple[float, float] | None) -> bool:
    return said is not None and not _agrees(glass, said)


def _agrees(glass: Glass, said: tuple[float, float]) -> bool:
    """Whether a glass has the index that a file gives; True outside of its data."""
    index = _at_d(glass)
    low, high = glass.dispersion.range_nm
    return not low <= LINE_NM["d"] <= high or abs(index - said[0]) <= _LIKE


def _at_d(glass: Glass) -> float:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OutOfRangeWarning)
        return float(glass.index(LINE_NM["d"]))


def _in_catalogues(name: str, catalogues: tuple[str, ...]) -> Glass | None:
    """The glass of the first of these catalogues that has it."""
    for catalogue in catalogues:
        if catalogue.casefold().startswith(_OF_MATERIALS):
            material = _MATERIALS.get(loose_key(name))
            if material is not None:
                return find_shipped(material)
        for maker in MAKERS:
            if catalogue.casefold().startswith(maker.casefold()):
                found = find_shipped(name, maker)
                if found is not None:
                    return found
    return None


def _everywhere(name: str) -> list[Glass]:
    """What all materials and makers have under a name."""
    material = _MATERIALS.get(loose_key(name))
    found = [find_shipped(material) if material else None]
    found += [find_shipped(name, maker) for maker in MAKERS]
    if not any(found):
        found = [find_shipped(name)]
    return [glass for glass in found if glass is not None]


def _full_name(glass: Glass) -> str:
    return f"{glass.maker} {glass.name}" if glass.maker else glass.name


def _look_further(name: str) -> Glass | None:
    """A glass of any catalogue; slow where the package opticalglass is asked."""
    try:
        return find_glass(name)
    except (SceneError, MissingExtra):
        return None


def _twins(name: str) -> Iterator[tuple[str, str]]:
    """What else a name may mean, and what to say of it."""
    moulded = re.fullmatch(r"(.+?)[_-]?MOLD(ED)?|((D|L|M|P)-.+)M", name, re.IGNORECASE)
    if moulded:
        yield (
            moulded[1] or moulded[3],
            "moulding lowers the index by some 0.003, which catalogues do not list",
        )
    yield f"N-{name}", "the lead-free successor; its index differs in the fourth place"


def _cauchy(index: float, abbe: float) -> list[float]:
    """n = A + B / λ² through the index at the d line and the Abbe number, λ in µm."""
    if abbe <= 0.0:
        return [index]
    d, f, c = (1e-6 * LINE_NM[line] ** 2 for line in ("d", "F", "C"))
    b = (index - 1.0) / abbe / (1.0 / f - 1.0 / c)
    return [index - b / d, b]
