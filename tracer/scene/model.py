"""The scene description: what may stand in a scene file, validated.

Every table of bodies, media, surfaces, sources and detectors is keyed by name, so names are unique
and every message can say where it is. A `Scene` is immutable.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, SerializeAsAny

from tracer.bodies.body import Body
from tracer.description.channels import Spectrum
from tracer.description.fields import Node
from tracer.detectors.detector import DetectorKind
from tracer.media.model import MediumModel
from tracer.scene.selecting import Selecting
from tracer.scene.variance_reduction import TraceModel
from tracer.sources.source import Source
from tracer.surfaces.surface import Surface

__all__ = ["Limits", "Scene", "World"]


class Limits(Node):
    """``depth``: most surfaces and scatterings that a ray meets before it is stopped."""

    depth: Annotated[int, Field(ge=1, le=2**20)] = 1000


class World(Node):
    """What is everywhere outside the bodies."""

    medium: str = "air"


class Scene(Node):
    """A whole scene, as validated; `tracer.compile_scene` turns it into arrays.

    ``contacts`` : pairs of bodies beside crystals that touch along a common face
    ``variants`` : of the text, that were laid over it
    ``files`` : that were read for the description: where, by the names that the text gives
    """

    title: str = ""
    length_unit: Literal["mm", "cm", "m", "um", "in"]
    flux_unit: Literal["W", "lm"] = "W"
    spectrum: Spectrum = Spectrum()
    world: World = World()
    limits: Limits = Limits()
    trace: TraceModel = TraceModel()
    media: dict[str, SerializeAsAny[MediumModel]] = {}
    surfaces: dict[str, SerializeAsAny[Surface]] = {}
    bodies: dict[str, SerializeAsAny[Body]] = {}
    sources: dict[str, SerializeAsAny[Source]] = {}
    detectors: dict[str, SerializeAsAny[DetectorKind]] = {}
    contacts: tuple[tuple[str, str], ...] = ()
    selecting: Selecting = Selecting()
    variants: tuple[str, ...] = ()
    files: dict[str, str] = {}
    text: str = ""
    origin: str = "scene"
    folder: str = "."

    @property
    def crystalline(self) -> bool:
        """Whether light splits in two in the medium of a body, or of the world."""
        used = {self.world.medium, *(body.medium for body in self.bodies.values())}
        return any(model.splits for name, model in self.media.items() if name in used)

    @property
    def light(self) -> str:
        """Which way of following light it asks for: natural, polarised or lens_trees."""
        if self.trace.lens_trees is not None:
            return "lens_trees"
        return self.trace.light
