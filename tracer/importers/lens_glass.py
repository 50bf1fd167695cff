"""Glasses of lens files as media of a scene: the makers' catalogues, the file's own, or a twin.

Programs write names in their own ways (NBK7_SCHOTT, SILICA, L-TIM28_MOLD). A name that only means
another glass is taken for it, with a warning that says so.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

from raymap.errors import MissingExtra, SceneError
from tracer.importers.prescription import GlassName, ImportWarning
from tracer.optics.dispersion import LINE_NM
from tracer.optics.glasses import MAKERS, Glass, find_glass, find_shipped
from tracer.optics.maker_glasses import loose_key, similar_rows

__all__ = ["medium_of_glass"]

_OTHER_NAMES = {
    "silica": "fused silica",
    "fsilica": "fused silica",
    "fusedsilica": "fused silica",
    "quartz": "fused silica",
    "caf2": "CaF2",
    "mgf2": "MgF2 o",
    "sapphire": "sapphire o",
    "calcite": "calcite o",
    "acrylic": "PMMA",
    "polycarb": "polycarbonate",
    "polystyr": "polystyrene",
    "seawater": "water",
    "h2o": "water",
    "znse": "ZnSe",
}
"""Names of materials without a maker, as design programs write them."""


def medium_of_glass(
    glass: GlassName,
    *,
    makers: tuple[str, ...] = (),
    given: Mapping[str, str] | None = None,
    place: str = "",
) -> tuple[str, dict[str, Any]]:
    """A name for the medium, and its table in a scene (empty: the scene has that medium itself).

    Parameters
    ----------
    makers : catalogues in the order in which the file looks glasses up
    given : what the user says that a name means: another glass, or a medium of the scene ("": the
        scene has a medium of this very name)
    place : file and surface, for messages

    Raises
    ------
    SceneError
        where nobody knows the glass; it names the nearest ones and says what to do
    """
    if given and glass.name in given:
        meant = given[glass.name]
        if not meant:
            return glass.name, {}
        found = _look_up(meant, ()) or _look_further(meant)
        return (meant, {"glass": _full_name(found)}) if found else (meant, {})
    if glass.model is not None:
        index, abbe = glass.model
        return f"glass {index:.5g} {abbe:.4g}", {"cauchy": _cauchy(index, abbe)}
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
    preferred = tuple(maker for maker in _makers_of((glass.maker, *makers)))
    name = _OTHER_NAMES.get(loose_key(glass.name), glass.name)
    found = _look_up(name, preferred)
    if found is None:
        for twin, why in _twins(glass.name):
            found = _look_up(twin, preferred)
            if found is not None:
                warnings.warn(
                    f"{place}: glass {glass.name!r} is taken for {_full_name(found)}: {why}",
                    ImportWarning,
                    stacklevel=2,
                )
                break
    found = found or _look_further(name)
    if found is None:
        near = similar_rows(glass.name)
        names = f"; the nearest names are {', '.join(near)}" if near else ""
        raise SceneError(
            f"{place}: no catalogue has the glass {glass.name!r}{names}; name what to take in a "
            f'scene file: [lens_files.NAME] with glasses = {{ "{glass.name}" = "N-BK7" }}, '
            f'or give it as [media."{glass.name}"]'
        )
    return found.name, {"glass": _full_name(found)}


def _full_name(glass: Glass) -> str:
    return f"{glass.maker} {glass.name}" if glass.maker else glass.name


def _makers_of(names: tuple[str, ...]) -> Iterator[str]:
    """Makers that catalogue names speak of: SUMITA_AUG2011 is Sumita."""
    for name in names:
        for maker in MAKERS:
            if name.casefold().startswith(maker.casefold()):
                yield maker


def _look_up(name: str, makers: tuple[str, ...]) -> Glass | None:
    """A glass of the shipped tables by name, of these makers first."""
    for maker in (*makers, None):
        found = find_shipped(name, maker)
        if found is not None:
            return found
    return None


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
