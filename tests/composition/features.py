"""Columns of the table: a small scene for each feature, and the same scene without it.

Light runs along z from a beam at z = -10 past the feature at z = 0. ``ahead`` sees what goes on,
``back`` what returns; both are planes that light passes. Features are met at right angles by light
of one wavelength, so that natural and polarised light have equal fluxes at the first crossing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from raymap import rayfiles
from raymap.rayfiles.rays import RaySet

__all__ = ["FEATURES", "Feature", "scene", "write_files"]

HEAD = """
length_unit = "mm"
[media.glass]
index = 1.5
[media.flint]
index = 1.8
[surfaces.black]
kind = "absorber"
"""
LAMP = """
[sources.lamp]
kind = "collimated"
position = [0, 0, -10]
direction = [0, 0, 1]
diameter = 2
"""
AHEAD = """
[detectors.ahead]
position = [0, 0, 40]
looks = [0, 0, -1]
size = [8, 8]
cells = [4, 4]
"""
BACK = """
[detectors.back]
position = [0, 0, -20]
looks = [0, 0, 1]
size = [60, 60]
cells = [4, 4]
"""


@dataclass(frozen=True, kw_only=True)
class Feature:
    """A column.

    Attributes
    ----------
    on, off : texts of the scene with the feature and without it
    detector : that tells them apart
    """

    on: str
    off: str
    detector: str = "ahead"


def plate(surface: str = "", medium: str = "glass", name: str = "plate", z: float = 0.0) -> str:
    return f"""
[bodies.{name}]
kind = "box"
size = [20, 20, 4]
position = [0, 0, {z}]
medium = "{medium}"
{f'surface = "{surface}"' if surface else ""}
"""


def sheet(surface: str) -> str:
    return f"""
[bodies.sheet]
kind = "rectangle"
size = [20, 20]
surface = "{surface}"
"""


def scene(
    *parts: str, lamp: str = LAMP, wavelengths: str = "550", planes: str = AHEAD + BACK
) -> str:
    """A scene in one wavelength, unless more are given."""
    spectrum = f'[spectrum]\nkind = "spectral"\nwavelengths_nm = [{wavelengths}]\n'
    return HEAD + spectrum + "".join(parts) + lamp + planes


def _of_surface(
    keys: str, *, body: str = "plate", without: str = "", detector: str = "ahead"
) -> Feature:
    """A surface of one kind on a plate or a sheet, against the bare plate or the open air."""
    own = plate("own") if body == "plate" else sheet("own")
    return Feature(
        on=scene(f"[surfaces.own]\n{keys}\n", own),
        off=scene(without or (plate() if body == "plate" else "")),
        detector=detector,
    )


_WIDE = """
[sources.lamp]
kind = "lambertian"
position = [0, 0, -10]
direction = [0, 0, 1]
size = [4, 4]
cone_deg = 20
"""

_SKIN = """
[detectors.skin]
kind = "surface"
face = "plate.z_min"
cells = [4, 4]
"""
_FAR = """
[detectors.far]
kind = "far_field"
axis = [0, 0, 1]
gamma_deg = [0, 30]
cells = [1, 3]
"""
_CAMERA = """
[detectors.cam]
kind = "camera"
position = [0, 0, -30]
looks = [0, 0, 1]
field_deg = [40, 40]
aperture = 12
focus = 30
cells = [4, 4]
"""
_PINHOLE = """
[detectors.hole]
kind = "pinhole"
position = [0, 0, -30]
looks = [0, 0, 1]
field_deg = [30, 30]
cells = [4, 4]
"""


def _diffuser(reflectance: float) -> str:
    keys = f"[surfaces.own]\nkind = 'lambertian'\nreflectance = {reflectance}\n"
    return scene(keys, sheet("own"))


FEATURES: dict[str, Feature] = {
    "plane faces": Feature(on=scene(plate()), off=scene()),
    "curved faces": Feature(
        on=scene(
            '[bodies.lens]\nkind = "lens"\nmedium = "glass"\nthickness = 4\ndiameter = 12\n'
            "front = { radius = -6.5 }\nback = { radius = 6.5 }\n"
        ),
        off=scene(plate()),
    ),
    "meshes": Feature(
        on=scene(
            '[bodies.mesh]\nkind = "mesh"\nfile = "block.stl"\nscale = 1.0\nmedium = "glass"\n'
        ),
        off=scene(),
    ),
    "coincident faces": Feature(
        on=scene(plate(), plate(medium="flint", name="second", z=4.0)),
        off=scene(plate(), plate(medium="flint", name="second", z=5.0)),
    ),
    "reflectance": _of_surface('kind = "dielectric"\nreflectance = 0.4'),
    "stack of layers": _of_surface(
        'kind = "dielectric"\n'
        'coating = { between = ["air", "glass"], layers = [{ index = 2.3, thickness_nm = 60 }] }'
    ),
    "measured coating": _of_surface(
        'kind = "dielectric"\ncoating = { wavelength_nm = [400, 700], angle_deg = [0, 90], '
        "reflectance = [[0.3, 0.3], [0.3, 0.3]], transmittance = [[0.6, 0.6], [0.6, 0.6]] }"
    ),
    "metal": _of_surface(
        'kind = "mirror"\nmetal = { n = 0.2, k = 3.4 }', body="sheet", detector="back"
    ),
    "rough glass": _of_surface('kind = "rough_dielectric"\nroughness = 0.3'),
    "rough metal": _of_surface(
        'kind = "rough_mirror"\nroughness = 0.3\nmetal = { n = 0.2, k = 3.4 }',
        body="sheet",
        detector="back",
    ),
    "scatter about specular light": _of_surface(
        'kind = "mirror"\nreflectance = 0.8\nscatter = { abg = [0.2, 0.5, 2.0] }',
        body="sheet",
        without='[surfaces.own]\nkind = "mirror"\nreflectance = 0.8\n' + sheet("own"),
        detector="back",
    ),
    "diffuse surface": _of_surface(
        'kind = "lambertian"\nreflectance = 0.3\ntransmittance = 0.5', body="sheet"
    ),
    "filter": _of_surface('kind = "filter"\ntransmittance = 0.5', body="sheet"),
    "retroreflector": _of_surface(
        'kind = "retroreflector"\nreflectance = 0.7', body="sheet", detector="back"
    ),
    "polariser": _of_surface('kind = "polariser"\nabsorbs = [0, 1, 0]', body="sheet"),
    "absorption": Feature(
        on=scene("[media.grey]\nindex = 1.5\nabsorption = 0.2\n", plate(medium="grey")),
        off=scene(plate()),
    ),
    "volume scattering": Feature(
        on=scene(
            "[media.fog]\nindex = 1.0\nscattering = { mean_free_path = 4, "
            'phase = { kind = "henyey_greenstein", g = 0.5 } }\n',
            plate(medium="fog"),
        ),
        off=scene(),
    ),
    "dispersion": Feature(
        on=scene(
            "[media.prism]\nindex = { wavelength_nm = [450, 650], value = [2.4, 1.2] }\n",
            plate(medium="prism"),
            wavelengths="450, 650",
        ),
        off=scene("[media.prism]\nindex = 1.2\n", plate(medium="prism"), wavelengths="450, 650"),
    ),
    "wide source": Feature(on=scene(plate(), lamp=_WIDE), off=scene(plate())),
    "blocking detector": Feature(
        on=scene(plate()).replace("cells = [4, 4]", "cells = [4, 4]\nblocking = true", 1),
        off=scene(),
    ),
    "far field": Feature(on=scene(plate()) + _FAR, off=scene() + _FAR, detector="far"),
    "camera": Feature(on=_diffuser(0.9) + _CAMERA, off=_diffuser(0.1) + _CAMERA, detector="cam"),
    "map of a surface": Feature(
        on=scene(plate(z=10.0)) + _SKIN,
        off=scene(sheet("black"), plate(z=10.0)) + _SKIN,
        detector="skin",
    ),
    "pinhole": Feature(
        on=_diffuser(0.9) + _PINHOLE, off=_diffuser(0.1) + _PINHOLE, detector="hole"
    ),
}
"""Columns, in the order of the page."""


def write_files(folder: Path) -> None:
    """The mesh, picture and list of rays that scenes name, beside them."""
    import numpy as np
    import trimesh
    from PIL import Image

    trimesh.creation.box((20.0, 20.0, 4.0)).export(folder / "block.stl")
    Image.fromarray(np.array([[[250] * 3, [90] * 3]] * 2, np.uint8)).save(folder / "picture.png")
    random = np.random.default_rng(1)
    position = np.column_stack([random.uniform(-2.0, 2.0, (500, 2)), np.zeros(500)])
    direction = np.column_stack([random.uniform(-0.3, 0.3, (500, 2)), np.ones(500)])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rays = RaySet(
        position=position.astype(np.float32),
        direction=direction.astype(np.float32),
        flux=random.uniform(0.5, 1.5, 500).astype(np.float32),
        length_unit="mm",
        flux_unit="W",
    )
    rayfiles.write(rays, folder / "rays.tm25ray")
