"""Rough interfaces of microscopic facets: nothing is absorbed, each facet obeys Fresnel."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from raymap.laws.smooth import FresnelLaw

__all__ = ["RoughLaw"]


class RoughLaw(FresnelLaw):
    """GGX facets of a roughness (alpha); its shares are those of a facet."""

    law: Literal["rough"] = "rough"  # type: ignore[assignment]
    roughness: Annotated[float, Field(gt=0.0)]
