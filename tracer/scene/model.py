"""The scene description: what may stand in a scene file, validated.

Every table of bodies, media, surfaces, sources and detectors is keyed by name, so names are unique
and every message can say where it is. A `Scene` is immutable.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, SerializeAsAny, SerializerFunctionWrapHandler, model_serializer

from raymap.model.limits import MAX_CHANNELS
from tracer.bodies.body import Body
from tracer.description.fields import Finite, Length, Node, Positive, Share, Spectral
from tracer.detectors.model import DetectorModel
from tracer.scene.rare_light import TraceModel
from tracer.scene.selecting import Selecting
from tracer.sources.model import SourceModel

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
        if isinstance(self.wavelengths_nm, tuple) and len(self.wavelengths_nm) > MAX_CHANNELS:
            raise ValueError(
                f"{len(self.wavelengths_nm)} wavelengths; a map may have {MAX_CHANNELS} channels"
            )

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

    b: tuple[Finite, Finite, Finite]
    c: tuple[Finite, Finite, Finite]


class Phase(Node):
    """Phase function of a scattering medium."""

    kind: Literal["isotropic", "henyey_greenstein", "generalized", "rayleigh", "tabulated"]
    g: Annotated[float, Field(gt=-1, lt=1)] = 0.0
    gamma: Annotated[float, Field(ge=-1000, le=1000)] = 1.5
    angle_deg: tuple[Finite, ...] = ()
    value: tuple[Finite, ...] = ()


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
    """A medium: one way to give its index, or a crystal; absorption and scattering if it has them.

    With ``albedo`` the free path of ``scattering`` counts scattering and absorption together.
    """

    index: Spectral | None = None
    sellmeier: Sellmeier | None = None
    cauchy: tuple[Finite, ...] | None = None
    glass: str | None = None
    crystal: dict[str, Any] | None = None
    absorption: Spectral | None = None
    scattering: Scattering | None = None

    def model_post_init(self, context: Any) -> None:
        given = [self.index, self.sellmeier, self.cauchy, self.glass, self.crystal]
        if sum(item is not None for item in given) != 1:
            raise ValueError("give exactly one of index, sellmeier, cauchy, glass or crystal")
        if self.crystal is not None and (self.absorption or self.scattering):
            raise ValueError("absorption of a crystal stands in its table: crystal.absorption")

    @model_serializer(mode="wrap")
    def _without_crystal(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Scenes without crystals keep the fingerprint that they had before there were any."""
        given: dict[str, Any] = handler(self)
        if given.get("crystal", 0) is None:
            del given["crystal"]
        return given


class Metal(Node):
    """Refractive index n + i k of a metal."""

    n: Spectral
    k: Spectral


class CoatingLayer(Node):
    """A layer of a stack: index n + i k and thickness [nm]."""

    index: Spectral
    extinction: Spectral | None = None
    thickness_nm: Annotated[Length, Field(ge=0)]


class Coating(Node):
    """A stack of ``layers`` from the first of two media ``between`` to the second, or a
    measurement: reflectance and transmittance, a row per wavelength with a value per angle."""

    layers: tuple[CoatingLayer, ...] = ()
    between: tuple[str, str] | None = None
    wavelength_nm: tuple[Positive, ...] = ()
    angle_deg: tuple[Finite, ...] = ()
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

    abg: tuple[Finite, Finite, Finite] | None = None
    harvey_shack: tuple[Finite, Finite, Finite] | None = None
    reference_nm: Positive | None = None

    def model_post_init(self, context: Any) -> None:
        if (self.abg is None) == (self.harvey_shack is None):
            raise ValueError("give either abg = [A, B, g] or harvey_shack = [b, width, s]")


class MeasuredScatter(Node):
    """A measured isotropic BSDF [1/sr]: values per angle of incidence, angle of scattering, azimuth
    (0: the side of the specular ray)."""

    theta_i_deg: tuple[Finite, ...]
    theta_o_deg: tuple[Finite, ...]
    phi_deg: tuple[Finite, ...]
    values: tuple[tuple[tuple[Finite, ...], ...], ...]


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

    ``scatter`` is a BSDF of a dielectric or mirror; what it scatters is taken from their specular
    light.
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
    roughness: Finite | None = None
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


class Limits(Node):
    """``depth``: most surfaces and scatterings that a ray meets before it is stopped."""

    depth: Annotated[int, Field(ge=1, le=2**20)] = 1000


class World(Node):
    """What is everywhere outside the bodies."""

    medium: str = "air"


class Scene(Node):
    """A whole scene, as validated; `tracer.compile_scene` turns it into arrays.

    ``contacts`` : pairs of crystals that touch along a common face
    """

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
    contacts: tuple[tuple[str, str], ...] = ()
    selecting: Selecting = Selecting()
    text: str = ""
    origin: str = "scene"
    folder: str = "."

    @property
    def has_crystals(self) -> bool:
        """Whether some body or the world is a crystal."""
        used = {self.world.medium, *(body.medium for body in self.bodies.values())}
        return any(
            name in used and medium.crystal is not None for name, medium in self.media.items()
        )

    @property
    def light(self) -> str:
        """Which way of following light it asks for: natural, polarised, lens_trees or crystals."""
        if self.has_crystals:
            return "crystals"
        if self.trace.lens_trees is not None:
            return "lens_trees"
        return self.trace.light
