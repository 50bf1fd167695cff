"""Media in the scene description."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from tracer.description.fields import Finite, Node, Positive, Share, Spectral

__all__ = ["MediumModel", "Phase", "Scattering", "Sellmeier"]


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

    def model_post_init(self, context: Any) -> None:
        keys = _PHASE_KEYS[self.kind]
        for name in sorted(self.model_fields_set - {"kind", *keys}):
            takes = ", ".join(keys) or "no other keys"
            raise ValueError(f"the {self.kind} phase function has no {name}; it takes {takes}")


_PHASE_KEYS: dict[str, tuple[str, ...]] = {
    "isotropic": (),
    "henyey_greenstein": ("g",),
    "generalized": ("g", "gamma"),
    "rayleigh": (),
    "tabulated": ("angle_deg", "value"),
}


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
