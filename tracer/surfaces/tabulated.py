"""Measured scatter of both sides."""

from __future__ import annotations

from typing import Any, Literal

from raymap.jit.kernels import inner_kernel, stage_kernel
from raymap.jit.types import F64
from raymap.laws import tabulated
from raymap.laws.law import Law as StoredLaw
from raymap.laws.tabulated import MeasuredBsdf, TabulatedLaw, eval_tabulated, tabulated_share
from tracer.compiled import S_REFLECTED, S_TRANSMITTED, TABULATED
from tracer.description.fields import Finite, Node
from tracer.optics.bsdf import pdf_tabulated, sample_tabulated
from tracer.rays.random import five_uniform
from tracer.surfaces.interaction import (
    ABSORBED,
    GLOSSY_REFLECTION,
    GLOSSY_TRANSMISSION,
    Hit,
    Light,
    Optics,
    Outcome,
)
from tracer.surfaces.surface import Surface, SurfaceRow

__all__ = [
    "MeasuredScatter",
    "Tabulated",
    "draw_tabulated",
    "meet_tabulated",
    "towards_tabulated",
    "weigh_tabulated",
]


@inner_kernel
def _shares(optics: Optics, hit: Hit) -> tuple[int, int, float, float]:
    """Tables of both sides, and what they scatter."""
    back = optics.surface_i[hit.surface, S_REFLECTED]
    through = optics.surface_i[hit.surface, S_TRANSMITTED]
    return (
        back,
        through,
        tabulated_share(optics.tables, back, hit.wz) if back >= 0 else 0.0,
        tabulated_share(optics.tables, through, hit.wz) if through >= 0 else 0.0,
    )


@stage_kernel
def meet_tabulated(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """Measured scatter to either side; the same table for all channels."""
    tables, code = optics.tables, light.code
    back, through, reflected, transmitted = _shares(optics, hit)
    u, state = five_uniform(light.state)
    if u[0] < reflected:
        x, y, z = sample_tabulated(tables, back, hit.wx, hit.wy, hit.wz, u[1], u[2], u[3], 1.0)
        return GLOSSY_REFLECTION, x, y, z, code, state
    if u[0] < reflected + transmitted:
        x, y, z = sample_tabulated(tables, through, hit.wx, hit.wy, hit.wz, u[1], u[2], u[3], -1.0)
        return GLOSSY_TRANSMISSION, x, y, z, code, state
    return ABSORBED, 0.0, 0.0, 1.0, code, state


@stage_kernel
def draw_tabulated(optics: Optics, hit: Hit, light: Light) -> Outcome:
    """Sides in the proportion of their light."""
    tables, code = optics.tables, light.code
    back, through, reflected, transmitted = _shares(optics, hit)
    u, state = five_uniform(light.state)
    if not reflected + transmitted > 0.0:
        return ABSORBED, 0.0, 0.0, 1.0, code, state
    if u[0] * (reflected + transmitted) < reflected:
        x, y, z = sample_tabulated(tables, back, hit.wx, hit.wy, hit.wz, u[1], u[2], u[3], 1.0)
        return GLOSSY_REFLECTION, x, y, z, code, state
    x, y, z = sample_tabulated(tables, through, hit.wx, hit.wy, hit.wz, u[1], u[2], u[3], -1.0)
    return GLOSSY_TRANSMISSION, x, y, z, code, state


@stage_kernel
def weigh_tabulated(
    optics: Optics, hit: Hit, light: Light, x: float, y: float, z: float, row: int
) -> float:
    """What both sides scatter goes on, in all channels."""
    back, through, reflected, transmitted = _shares(optics, hit)
    for k in range(light.colors.shape[1]):
        light.colors[row, k] = reflected + transmitted
    table, side, part = (back, 1.0, reflected) if z > 0.0 else (through, -1.0, transmitted)
    if table < 0:
        return 0.0
    density = pdf_tabulated(optics.tables, table, hit.wx, hit.wy, hit.wz, x, y, z, side)
    return density * part / (reflected + transmitted)


@stage_kernel
def towards_tabulated(optics: Optics, hit: Hit, x: float, y: float, z: float, out: F64) -> bool:
    """Light that is scattered from w to a direction."""
    column = S_REFLECTED if z > 0.0 else S_TRANSMITTED
    table = optics.surface_i[hit.surface, column]
    if table < 0:
        return False
    side = 1.0 if z > 0.0 else -1.0
    value = eval_tabulated(optics.tables, table, hit.wx, hit.wy, hit.wz, x, y, z, side) * abs(z)
    for k in range(len(out)):
        out[k] = value
    return bool(value > 0.0)


class MeasuredScatter(Node):
    """A measured isotropic BSDF [1/sr]: values per angle of incidence, angle of scattering, azimuth
    (0: the side of the specular ray)."""

    theta_i_deg: tuple[Finite, ...]
    theta_o_deg: tuple[Finite, ...]
    phi_deg: tuple[Finite, ...]
    values: tuple[tuple[tuple[Finite, ...], ...], ...]


class Tabulated(Surface):
    """Measured scatter, ``reflected`` and ``transmitted``; the rest is absorbed."""

    kind: Literal["tabulated"] = "tabulated"
    reflected: MeasuredScatter | None = None
    transmitted: MeasuredScatter | None = None
    number = TABULATED
    meet = meet_tabulated
    towards = towards_tabulated
    draw = draw_tabulated
    weigh = weigh_tabulated

    def model_post_init(self, context: Any) -> None:
        if not (self.reflected or self.transmitted):
            raise ValueError("a tabulated surface needs reflected or transmitted values")

    def compile(self, row: SurfaceRow) -> None:
        shares = []
        for column, given in ((S_REFLECTED, self.reflected), (S_TRANSMITTED, self.transmitted)):
            if given is None:
                continue
            table = tabulated.tabulated_bsdf(
                given.theta_i_deg, given.theta_o_deg, given.phi_deg, given.values, name=row.name
            )
            row.integers[column] = row.pool.add(table)
            shares.append(table)
        tabulated.check_energy(
            lambda cosine: sum(float(tabulated.tabulated_share(t, 0, cosine)) for t in shares),
            name=row.name,
        )

    def stated(self, row: SurfaceRow) -> StoredLaw | None:
        sides = (
            None if given is None else MeasuredBsdf(**given.model_dump())
            for given in (self.reflected, self.transmitted)
        )
        return TabulatedLaw(reflected=next(sides), transmitted=next(sides))

    def transmits(self) -> bool:
        return self.transmitted is not None


KINDS = (Tabulated,)
