"""Scenes of three things at once, drawn by chance: ways of following light check each other.

One or two elements stand behind one another in the light of a source and are seen by a detector.
Natural light is followed analog, weighted and split, polarised light in the same ways and beside a
crystal: all of one light must see the same flux within their errors. Natural and polarised light
differ, as they should, where light meets faces aslant.
"""

from __future__ import annotations

import itertools
import random
from dataclasses import dataclass

from tests.composition.features import scene
from tests.composition.table import apart, counted

__all__ = ["AGREE", "DETECTORS", "ELEMENTS", "SOURCES", "WAYS", "Combination", "drawn", "judged"]

AGREE = 4.5
"""Standard errors within which all pairs of some thousand agree."""
_SURE = 0.2
"""Relative standard error beyond which a flux decides nothing."""

WAYS = {
    "natural": ("analog", "weighted", "splitting"),
    "polarised": (
        "polarised",
        "polarised, weighted",
        "polarised, splitting",
        "crystals",
        "crystals, weighted",
    ),
}
_NO_PINHOLE = ("crystals", "crystals, weighted")
"""Ways of polarised light that refuse pinholes."""


def _solid(surface: str = "", medium: str = "glass") -> str:
    own = f'surface = "own@"\n[surfaces.own@]\n{surface}\n' if surface else ""
    box = '[bodies.b@]\nkind = "box"\nsize = [20, 20, 3]\nposition = [0, 0, Z]\n'
    return f'{box}medium = "{medium}"\n{own}'


def _thin(surface: str, turned: str = "") -> str:
    return (
        '[bodies.b@]\nkind = "rectangle"\nsize = [20, 20]\nposition = [0, 0, Z]\n'
        f'{turned}surface = "own@"\n[surfaces.own@]\n{surface}\n'
    )


ELEMENTS: dict[str, str] = {
    "plate": _solid(),
    "lens": '[bodies.b@]\nkind = "lens"\nmedium = "glass"\nthickness = 5\ndiameter = 16\n'
    "position = [0, 0, Z]\nfront = { radius = 20 }\nback = { radius = -20 }\n",
    "ball": '[bodies.b@]\nkind = "sphere"\nmedium = "flint"\nradius = 2.5\nposition = [0, 0, Z]\n',
    "mesh": '[bodies.b@]\nkind = "mesh"\nfile = "block.stl"\nscale = 1.0\nmedium = "glass"\n'
    "position = [0, 0, Z]\n",
    "coincident faces": _solid()
    + '[bodies.c@]\nkind = "box"\nsize = [20, 20, 1]\nposition = [0, 0, Z.2]\nmedium = "flint"\n',
    "reflectance": _solid('kind = "dielectric"\nreflectance = 0.3'),
    "stack of layers": _solid(
        'kind = "dielectric"\n'
        'coating = { between = ["air", "glass"], layers = [{ index = 2.3, thickness_nm = 60 }] }'
    ),
    "measured coating": _solid(
        'kind = "dielectric"\ncoating = { wavelength_nm = [400, 700], angle_deg = [0, 90], '
        "reflectance_s = [[0.3, 0.4], [0.3, 0.4]], reflectance_p = [[0.3, 0.2], [0.3, 0.2]], "
        "transmittance_s = [[0.6, 0.5], [0.6, 0.5]], transmittance_p = [[0.6, 0.7], [0.6, 0.7]] }"
    ),
    "tilted metal": _thin('kind = "mirror"\nmetal = { n = 1.4, k = 2.0 }', "axis = [1, 0, 1]\n"),
    "rough glass": _solid('kind = "rough_dielectric"\nroughness = 0.3'),
    "tilted rough metal": _thin(
        'kind = "rough_mirror"\nroughness = 0.4\nmetal = { n = 1.4, k = 2.0 }', "axis = [1, 0, 1]\n"
    ),
    "scatter": _solid('kind = "dielectric"\nscatter = { abg = [0.002, 0.1, 2.0] }'),
    "diffuser": _thin('kind = "lambertian"\nreflectance = 0.3\ntransmittance = 0.6'),
    "filter": _thin('kind = "filter"\ntransmittance = 0.5'),
    "retroreflector": _thin('kind = "retroreflector"\nreflectance = 0.6').replace(
        "[20, 20]", "[20, 3]"
    ),
    "polariser": _thin('kind = "polariser"\nabsorbs = [1, 2, 0]'),
    "retarder": _thin('kind = "retarder"\nslow = [1, 0.3, 0]\nretardance_nm = 137'),
    "absorption": "[media.grey@]\nindex = 1.5\nabsorption = 0.2\n" + _solid(medium="grey@"),
    "volume scattering": "[media.fog@]\nindex = 1.3\nscattering = { mean_free_path = 4, "
    'phase = { kind = "rayleigh" } }\n' + _solid(medium="fog@"),
    "dispersion": "[media.prism@]\nindex = { wavelength_nm = [450, 650], value = [2.0, 1.4] }\n"
    + _solid(medium="prism@"),
}  # fmt: skip
"""Texts of elements; ``@`` is their number and ``Z`` their place along the light."""

_AT = "[sources.lamp]\nposition = [0, 0, -10]\ndirection = [0, 0, 1]\n"
SOURCES: dict[str, str] = {
    "collimated": _AT + 'kind = "collimated"\ndiameter = 3\n',
    "polarised beam": _AT + 'kind = "collimated"\ndiameter = 3\npolarisation = [1, 1, 0]\n',
    "point": _AT + 'kind = "point"\ncone_deg = 20\n',
    "lambertian": _AT + 'kind = "lambertian"\nsize = [4, 2]\ncone_deg = 25\n',
    "elliptical": _AT + 'kind = "elliptical"\nsize = [4, 2]\nturn_deg = 20\n',
    "ring": _AT + 'kind = "ring"\ndiameter = 8\ninner_diameter = 7\ncone_deg = 25\n',
    "intensity": _AT + 'kind = "intensity"\nintensity = { gamma_deg = [0, 20], c_deg = [0], '
    "value = [[5], [1]] }\n",
    "picture": _AT + 'kind = "picture"\nfile = "picture.png"\nsize = [4, 3]\ncone_deg = 25\n',
    "rays": _AT + 'kind = "rays"\nfile = "rays.tm25ray"\n',
}

_PLANE = (
    "[detectors.seen]\nposition = [0, 0, {z}]\nlooks = [0, 0, {looks}]\n"
    "size = [{s}, {s}]\ncells = [2, 2]\n"
)
DETECTORS: dict[str, str] = {
    "plane ahead": _PLANE.format(z=30, looks=-1, s=30),
    "blocking plane": _PLANE.format(z=30, looks=-1, s=30) + "blocking = true\n",
    "plane behind": _PLANE.format(z=-14, looks=1, s=60),
    "far field": '[detectors.seen]\nkind = "far_field"\naxis = [0, 0, 1]\ngamma_deg = [0, 60]\n'
    "cells = [1, 3]\n",
    "camera": '[detectors.seen]\nkind = "camera"\nposition = [-6, 0, -30]\nlooks = [6, 0, 34]\n'
    "field_deg = [40, 40]\naperture = 16\nfocus = 34\ncells = [2, 2]\n",
    "map of a surface": '[bodies.wall]\nkind = "rectangle"\nsize = [40, 40]\n'
    'position = [0, 0, 32]\nsurface = "black"\n[detectors.seen]\nkind = "surface"\n'
    'face = "wall"\ncells = [2, 2]\n',
    "pinhole": '[detectors.seen]\nkind = "pinhole"\nposition = [-6, 0, -30]\nlooks = [6, 0, 34]\n'
    "field_deg = [40, 40]\ncells = [2, 2]\n",
}


@dataclass(frozen=True)
class Combination:
    """Elements in the light of a source, seen by a detector, by name."""

    elements: tuple[str, ...]
    source: str
    detector: str

    @property
    def text(self) -> str:
        parts = []
        for k, name in enumerate(self.elements):
            z = 8 * k
            text = ELEMENTS[name].replace("@", str(k))
            parts.append(text.replace("Z.2", str(z + 2)).replace("Z", str(z)))
        wavelengths = "450, 550, 650"
        return (
            scene(*parts, lamp=SOURCES[self.source], wavelengths=wavelengths, planes="")
            + (DETECTORS[self.detector])
        )


def drawn(seed: int) -> Combination:
    """A combination of three: two elements and a source or a detector, or one element and both."""
    draw = random.Random(seed)
    first, second = draw.choice(sorted(ELEMENTS)), draw.choice(sorted(ELEMENTS))
    source, detector = draw.choice(sorted(SOURCES)), draw.choice(sorted(DETECTORS))
    form = draw.randrange(3)
    if form == 0:
        return Combination((first, second), "collimated", detector)
    if form == 1:
        return Combination((first, second), source, "plane ahead")
    return Combination((first,), source, detector)


def judged(combination: Combination, rays: int) -> tuple[int, list[str]]:
    """Pairs of ways whose fluxes decide something, and those that disagree, in words."""
    decided, wrong = 0, []
    for light, ways in WAYS.items():
        modes = ways
        if combination.detector == "pinhole":
            modes = tuple(mode for mode in ways if mode not in _NO_PINHOLE)
        fluxes = {
            mode: counted(combination.text, "seen", mode=mode, seed=3 + k, rays=rays)
            for k, mode in enumerate(modes)
        }
        for one, other in itertools.combinations(modes, 2):
            if any(se > _SURE * flux for flux, se in (fluxes[one], fluxes[other])):
                continue
            decided += 1
            if not apart(fluxes[one], fluxes[other]) < AGREE:
                wrong.append(
                    f"{combination}: {light} light, {one} {fluxes[one]}, {other} {fluxes[other]}"
                )
    return decided, wrong
