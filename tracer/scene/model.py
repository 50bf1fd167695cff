"""The scene description: what may stand in a scene file, validated.

Every table of bodies, media, surfaces, sources and detectors is keyed by name, so names are unique
and every message can say where it is. A `Scene` is immutable.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, SerializeAsAny

from tracer.geometry.bodies import Body
from tracer.scene.fields import ByWavelength, Node, Placed, Positive, Share, Spectral, Vector
from tracer.scene.rare_light import TraceModel

__all__ = [
    "DetectorModel",
    "Limits",
    "MediumModel",
    "Scene",
    "SourceModel",
    "Spectrum",
    "SurfaceModel",
    "World",
]

RGB_NM = (611.0, 549.0, 464.0)
"""Wavelengths that stand for R, G and B."""

Array = NDArray[np.float64]


class Wavelengths(Node):
    """Evenly spaced wavelengths [nm]."""

    first: Positive
    last: Positive
    count: Annotated[int, Field(ge=1, le=4096)]


class Spectrum(Node):
    """Colour channels of the trace: R, G, B, or any wavelengths [nm]."""

    kind: Literal["rgb", "spectral"] = "rgb"
    wavelengths_nm: tuple[Positive, ...] | Wavelengths | None = None

    def model_post_init(self, context: Any) -> None:
        if (self.kind == "spectral") != (self.wavelengths_nm is not None):
            raise ValueError("wavelengths_nm goes with kind = 'spectral', and only with it")

    def channels(self) -> Array:
        """Wavelength of each channel [nm]."""
        if self.wavelengths_nm is None:
            return np.array(RGB_NM)
        if isinstance(self.wavelengths_nm, Wavelengths):
            w = self.wavelengths_nm
            return np.linspace(w.first, w.last, w.count)
        return np.array(self.wavelengths_nm)


class Sellmeier(Node):
    """n² = 1 + Σ b λ² / (λ² - c), λ in µm, c in µm²."""

    b: tuple[float, float, float]
    c: tuple[float, float, float]


class Phase(Node):
    """Phase function of a scattering medium."""

    kind: Literal["isotropic", "henyey_greenstein", "generalized", "rayleigh", "tabulated"]
    g: Annotated[float, Field(gt=-1, lt=1)] = 0.0
    gamma: float = 1.5
    angle_deg: tuple[float, ...] = ()
    value: tuple[float, ...] = ()


class Scattering(Node):
    """Volume scattering: mean free path of scattering [scene unit] or its coefficient."""

    mean_free_path: Positive | None = None
    coefficient: Spectral | None = None
    albedo: Share | None = None
    phase: Phase = Phase(kind="isotropic")

    def model_post_init(self, context: Any) -> None:
        if (self.mean_free_path is None) == (self.coefficient is None):
            raise ValueError("give either mean_free_path or coefficient")


class MediumModel(Node):
    """A medium: one way to give its index; absorption and scattering where it has them.

    With ``albedo`` the free path of ``scattering`` counts scattering and absorption together.
    """

    index: Spectral | None = None
    sellmeier: Sellmeier | None = None
    cauchy: tuple[float, ...] | None = None
    glass: str | None = None
    absorption: Spectral | None = None
    scattering: Scattering | None = None

    def model_post_init(self, context: Any) -> None:
        given = [self.index, self.sellmeier, self.cauchy, self.glass]
        if sum(item is not None for item in given) != 1:
            raise ValueError("give exactly one of index, sellmeier, cauchy or glass")


class Metal(Node):
    """Refractive index n + i k of a metal."""

    n: Spectral
    k: Spectral


class CoatingLayer(Node):
    """A layer of a stack: index n + i k and thickness [nm]."""

    index: Spectral
    extinction: Spectral | None = None
    thickness_nm: Annotated[float, Field(ge=0)]


class Coating(Node):
    """A stack of ``layers`` from the first of two media ``between`` to the second, or a
    measurement: reflectance and transmittance, a row per wavelength with a value per angle."""

    layers: tuple[CoatingLayer, ...] = ()
    between: tuple[str, str] | None = None
    wavelength_nm: tuple[Positive, ...] = ()
    angle_deg: tuple[float, ...] = ()
    reflectance: tuple[tuple[Share, ...], ...] = ()
    transmittance: tuple[tuple[Share, ...], ...] = ()

    def model_post_init(self, context: Any) -> None:
        if bool(self.layers) == bool(self.angle_deg):
            raise ValueError("give either layers and between, or a table over angle_deg")
        if bool(self.layers) != (self.between is not None):
            raise ValueError(
                "layers need the media that they lie between: between = [first, second]"
            )


class Scatter(Node):
    """Scatter about the specular direction: ABg (A, B, g) or Harvey-Shack (b, width, s).

    With ``reference_nm`` the law is scaled from that wavelength to each channel's.
    """

    abg: tuple[float, float, float] | None = None
    harvey_shack: tuple[float, float, float] | None = None
    reference_nm: Positive | None = None

    def model_post_init(self, context: Any) -> None:
        if (self.abg is None) == (self.harvey_shack is None):
            raise ValueError("give either abg = [A, B, g] or harvey_shack = [b, width, s]")


class MeasuredScatter(Node):
    """A measured isotropic BSDF [1/sr]: values per angle of incidence, angle of scattering, azimuth
    (0: the side of the specular ray)."""

    theta_i_deg: tuple[float, ...]
    theta_o_deg: tuple[float, ...]
    phi_deg: tuple[float, ...]
    values: tuple[tuple[tuple[float, ...], ...], ...]


class SurfaceModel(Node):
    """Optical properties of faces.

    absorber : takes all light
    dielectric : smooth interface of both media; bare, with a ``reflectance``, or with a ``coating``
    lambertian : diffuse ``reflectance`` and ``transmittance``, the rest is absorbed
    mirror : specular ``reflectance`` or that of a ``metal``, the rest is absorbed
    rough_dielectric, rough_mirror : GGX facets of ``roughness`` 0 .. 1 (alpha)
    filter : thin sheet with internal ``transmittance`` and ``index``; light goes straight on
    retroreflector : ``reflectance`` within ``spread_deg`` of the way back
    tabulated : measured scatter, ``reflected`` and ``transmitted``, the rest is absorbed

    ``scatter`` takes its share of the specular light of a dielectric or mirror.
    """

    kind: Literal[
        "absorber",
        "dielectric",
        "lambertian",
        "mirror",
        "rough_dielectric",
        "rough_mirror",
        "filter",
        "retroreflector",
        "tabulated",
    ]
    reflectance: Spectral | None = None
    transmittance: Spectral | None = None
    metal: Metal | None = None
    roughness: float | None = None
    coating: Coating | None = None
    scatter: Scatter | None = None
    index: Positive | None = None
    spread_deg: Annotated[float, Field(ge=0, le=90)] | None = None
    reflected: MeasuredScatter | None = None
    transmitted: MeasuredScatter | None = None

    def model_post_init(self, context: Any) -> None:
        keys = _SURFACE_KEYS[self.kind]
        for name in self.model_fields_set - {"kind"}:
            if name not in keys:
                allowed = ", ".join(keys) or "nothing else"
                raise ValueError(f"a {self.kind} surface has no {name}; it takes {allowed}")
        if self.kind in ("mirror", "rough_mirror") and (
            (self.reflectance is None) == (self.metal is None)
        ):
            raise ValueError(f"a {self.kind} surface needs either a reflectance or a metal")
        if self.kind == "lambertian" and not (self.reflectance or self.transmittance):
            raise ValueError("a lambertian surface needs a reflectance or a transmittance")
        if self.kind == "retroreflector" and self.reflectance is None:
            raise ValueError("a retroreflector needs a reflectance")
        if self.kind == "filter" and self.transmittance is None:
            raise ValueError("a filter needs a transmittance")
        if self.kind.startswith("rough") and self.roughness is None:
            raise ValueError(f"a {self.kind} surface needs a roughness (alpha of GGX)")
        if self.kind == "tabulated" and not (self.reflected or self.transmitted):
            raise ValueError("a tabulated surface needs reflected or transmitted values")
        if self.coating is not None and self.reflectance is not None:
            raise ValueError("give either a reflectance or a coating")


_SURFACE_KEYS: dict[str, tuple[str, ...]] = {
    "absorber": (),
    "dielectric": ("reflectance", "coating", "scatter"),
    "lambertian": ("reflectance", "transmittance"),
    "mirror": ("reflectance", "metal", "scatter"),
    "rough_dielectric": ("roughness",),
    "rough_mirror": ("roughness", "reflectance", "metal"),
    "filter": ("transmittance", "index"),
    "retroreflector": ("reflectance", "spread_deg"),
    "tabulated": ("reflected", "transmitted"),
}


class SourceModel(Placed):
    """A light source.

    collimated : parallel beam from a disc (``diameter``) or rectangle (``size``); along
        ``direction``, or through the point ``aim`` with the given direction, starting ``distance``
        before it
    lambertian : disc or rectangle that emits into the half space (or ``cone_deg``) along its axis
    point : from one point, uniform into all directions or within ``cone_deg`` of its axis
    """

    kind: Literal["collimated", "lambertian", "point"]
    on: bool = True
    flux: Positive = 1.0
    share: Positive | None = None
    spectrum: Literal["white"] | ByWavelength = "white"
    diameter: Positive | None = None
    inner_diameter: Annotated[float, Field(ge=0)] = 0.0
    size: tuple[Positive, Positive] | None = None
    direction: Vector | None = None
    aim: Vector | None = None
    distance: Positive | None = None
    cone_deg: Annotated[float, Field(gt=0, le=180)] | None = None
    inside: str | None = None

    def model_post_init(self, context: Any) -> None:
        super().model_post_init(context)
        if self.kind == "point":
            if self.diameter or self.size:
                raise ValueError("a point source has neither diameter nor size")
        elif (self.diameter is None) == (self.size is None):
            raise ValueError("give either diameter (a disc) or size (a rectangle)")
        if (self.aim is None) != (self.distance is None):
            raise ValueError("aim and distance go together")
        if self.aim is not None and "position" in self.model_fields_set:
            raise ValueError("give position, or aim and distance")
        if self.direction is not None and not any(self.direction):
            raise ValueError("direction must not be the zero vector")
        if self.direction is not None and (self.axis or self.rotation):
            raise ValueError("direction already turns the source; drop axis and rotation")
        if self.kind == "lambertian" and (self.cone_deg or 0.0) > 90.0:
            raise ValueError("cone_deg of a lambertian source is at most 90")

    def frame(self) -> tuple[Array, Array]:
        origin, frame = super().frame()
        if self.direction is not None:
            _, frame = Placed(axis=self.direction).frame()
        if self.aim is not None and self.distance is not None:
            origin = np.array(self.aim) - self.distance * frame[:, 2]
        return origin, frame


class DetectorModel(Node):
    """A rectangular grid of cells that ``looks`` in a direction, ``up`` along its v axis.

    Light that comes from where it looks registers. A blocking detector is also an object of its
    name, with ``surface`` (an absorber unless given).
    """

    position: Vector
    looks: Vector
    up: Vector = (0.0, 1.0, 0.0)
    size: tuple[Positive, Positive]
    cells: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]]
    blocking: bool = False
    surface: str | None = None
    acceptance_deg: Annotated[float, Field(gt=0, le=90)] = 90.0
    both_sides: bool = False

    def model_post_init(self, context: Any) -> None:
        if np.linalg.norm(np.cross(self.looks, self.up)) < 1e-9:
            raise ValueError("looks and up must be two different directions")
        if self.surface is not None and not self.blocking:
            raise ValueError("only a blocking detector has a surface")

    def axes(self) -> tuple[Array, Array, Array]:
        """Unit vectors u, v and looking direction n = u x v."""
        n = np.array(self.looks) / np.linalg.norm(self.looks)
        v = np.array(self.up) - (np.array(self.up) @ n) * n
        v /= np.linalg.norm(v)
        return np.cross(v, n), v, n


class Limits(Node):
    """``depth``: most surfaces and scatterings that a ray meets before it is stopped."""

    depth: Annotated[int, Field(ge=1, le=2**20)] = 1000


class World(Node):
    """What is everywhere outside the bodies."""

    medium: str = "air"


class Scene(Node):
    """A whole scene, as validated; `tracer.compile_scene` turns it into arrays."""

    title: str = ""
    length_unit: Literal["mm", "cm", "m", "um", "in"]
    flux_unit: Literal["W", "lm"] = "W"
    spectrum: Spectrum = Spectrum()
    world: World = World()
    limits: Limits = Limits()
    trace: TraceModel = TraceModel()
    media: dict[str, MediumModel] = {}
    surfaces: dict[str, SurfaceModel] = {}
    bodies: dict[str, SerializeAsAny[Body]] = {}
    sources: dict[str, SourceModel] = {}
    detectors: dict[str, DetectorModel] = {}
    text: str = ""
    origin: str = "scene"
    folder: str = "."


def cone_cosine(source: SourceModel) -> float:
    """Cosine that limits the directions of a source."""
    widest = 180.0 if source.kind == "point" else 90.0
    return math.cos(math.radians(source.cone_deg or widest))
