"""What kinds of surfaces say of their scattered light: a draw, its density, what goes on of it.

The density is held by the draws, what goes on by the BSDF that pinholes ask.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from raymap.jit.kernels import kernel
from raymap.optics.frames import frame_about
from tests.tracer.chi2 import chi2_sphere
from tests.tracer.transport.tracing import compiled
from tracer.compiled import S_KIND
from tracer.rays.colors import COLORS
from tracer.rays.random import stream_state
from tracer.surfaces.drawing import draw_scattered, weigh_scattered
from tracer.surfaces.interaction import Hit, Interface, Light, Optics, Way, optics_of
from tracer.surfaces.linking import link_surfaces
from tracer.surfaces.registry import SURFACES as KINDS
from tracer.surfaces.towards import scattered_towards

SURFACES = {
    "white": 'kind = "lambertian"\nreflectance = { rgb = [0.8, 0.6, 0.4] }',
    "milky": 'kind = "lambertian"\nreflectance = { rgb = [0.3, 0.1, 0.0] }\n'
    "transmittance = { rgb = [0.1, 0.5, 0.4] }",
    "ground": 'kind = "rough_dielectric"\nroughness = 0.4',
    "brushed": 'kind = "rough_mirror"\nroughness = 0.3\nreflectance = { rgb = [0.9, 0.5, 0.2] }',
    "gold": 'kind = "rough_mirror"\nroughness = 0.5\nmetal = { n = 0.3, k = 2.9 }',
    "beads": 'kind = "retroreflector"\nreflectance = 0.7\nspread_deg = 25',
    "measured": """kind = "tabulated"
reflected = { theta_i_deg = [0, 90], theta_o_deg = [0, 45, 90], phi_deg = [0, 180], values = [
[[0.1, 0.1], [0.15, 0.05], [0.0, 0.0]], [[0.1, 0.1], [0.15, 0.05], [0.0, 0.0]]] }
transmitted = { theta_i_deg = [0, 90], theta_o_deg = [0, 90], phi_deg = [0, 180], values = [
[[0.1, 0.1], [0.1, 0.1]], [[0.1, 0.1], [0.1, 0.1]]] }""",
}

COLOR = [0.5, 0.3, 0.2]
MIXED = 3
WAY = np.array([-0.5, 0.2, -np.sqrt(0.71)])


@kernel
def _draw(optics, tables, hit, light, out):  # type: ignore[no-untyped-def]
    state = light.state
    for i in range(len(out)):
        given = Light(light.code, light.colors, light.counters, state)
        _, out[i, 0], out[i, 1], out[i, 2], _, state = draw_scattered(optics, tables, hit, given)


@kernel
def _weigh(optics, tables, hit, light, directions, density):  # type: ignore[no-untyped-def]
    row = light.counters[COLORS] + 1
    shares = np.zeros((len(directions), light.colors.shape[1]))
    for i in range(len(directions)):
        x, y, z = directions[i]
        density[i] = weigh_scattered(optics, tables, hit, light, x, y, z, row)
        for k in range(shares.shape[1]):
            shares[i, k] = light.colors[row, k]
    return shares


@kernel
def _towards(optics, tables, at, way, directions, out):  # type: ignore[no-untyped-def]
    for i in range(len(directions)):
        x, y, z = directions[i]
        if not scattered_towards(optics, tables, at, way, x, y, z, out[i]):
            out[i] = 0.0


@kernel
def _frame(out):  # type: ignore[no-untyped-def]
    out[0, 0], out[0, 1], out[0, 2], out[1, 0], out[1, 1], out[1, 2] = frame_about(0.0, 0.0, 1.0)


class Asked:
    """A surface between air and a dispersive glass, met on the way `WAY`."""

    def __init__(self, name: str, code: int) -> None:
        scene = scene_of_all()
        names = [item.name for item in scene.directory.surfaces]
        arrays = scene.arrays._replace(surface_i=scene.arrays.surface_i.copy())
        link_surfaces(arrays.surface_i, towards=True, weighed=True)
        self.optics: Optics = optics_of.py_func(arrays)  # type: ignore[attr-defined]
        self.tables = arrays.tables
        media = [medium.name for medium in scene.directory.media]
        at = names.index(name), media.index("air"), media.index("glass")
        # In the plane z = 0 the local frame is that of the scene but for a turn
        self.turn = np.zeros((2, 3))
        _frame(self.turn)
        wx, wy = -(self.turn @ WAY)
        self.hit = Hit(*at, float(wx), float(wy), float(-WAY[2]))
        self.at, self.way = Interface(*at, float(-WAY[2])), Way(*WAY.tolist(), 0.0, 0.0, 1.0)
        colors = np.zeros((8, 3))
        colors[0] = COLOR
        counters = np.zeros(8, np.int64)
        counters[COLORS] = 1
        self.light = Light(code, colors, counters, stream_state(3, 5))

    def draws(self, n: int) -> Any:
        out = np.zeros((n, 3))
        _draw(self.optics, self.tables, self.hit, self.light, out)
        return out

    def weighed(self, directions: Any) -> tuple[Any, Any]:
        density = np.zeros(len(directions))
        shares = _weigh(self.optics, self.tables, self.hit, self.light, directions, density)
        return density, shares

    def towards(self, directions: Any) -> Any:
        """BSDF |z| by channel."""
        out = np.zeros((len(directions), 3))
        world = directions[:, :2] @ self.turn + directions[:, 2:] * [0.0, 0.0, 1.0]
        _towards(self.optics, self.tables, self.at, self.way, world, out)
        return out


@cache
def scene_of_all() -> Any:
    sheets = "".join(
        f'[surfaces.{name}]\n{text}\n[bodies.{name}]\nkind = "sphere"\nradius = 0.1\n'
        f'medium = "glass"\nposition = [0, 0, {k + 1}]\nsurface = "{name}"\n'
        for k, (name, text) in enumerate(SURFACES.items())
    )
    return compiled(
        "[media.glass]\nindex = { rgb = [1.5, 1.6, 1.7] }\n"
        f'[sources.lamp]\nkind = "point"\nposition = [3, 0, 0]\n{sheets}'
    )


CASES = [
    (name, code)
    for name in SURFACES
    for code in (0, MIXED)
    # Light of several channels is never in a dispersive glass together
    if (name, code) != ("ground", MIXED)
]


# Cells cannot follow the sharp edge of a retroreflector's cone: `test_bsdf` looks along its axis
@pytest.mark.parametrize(("name", "code"), [case for case in CASES if case[0] != "beads"])
def test_draws_have_the_density_that_is_said(name: str, code: int) -> None:
    asked = Asked(name, code)

    def density(x: float, y: float, z: float) -> float:
        return float(asked.weighed(np.array([[x, y, z]]))[0][0])

    chi2_sphere(asked.draws(20_000), density, cells=(16, 16), gauss=5)


@pytest.mark.parametrize(("name", "code"), CASES)
def test_what_goes_on_is_the_bsdf_over_the_density(name: str, code: int) -> None:
    asked = Asked(name, code)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    directions = np.concatenate([directions, asked.draws(500)])
    density, shares = asked.weighed(directions)
    found = np.where(density[:, None] > 0.0, density[:, None] * shares, 0.0)
    wanted = asked.towards(directions)
    # Where the light has one channel, it alone is asked for
    channels = [code] if code < MIXED else [0, 1, 2]
    np.testing.assert_allclose(found[:, channels], wanted[:, channels], rtol=1e-9, atol=1e-12)
    assert found[:, channels].max() > 0.0


def test_every_kind_that_scatters_is_asked() -> None:
    asked = [Asked(name, 0) for name in SURFACES]
    kinds = {int(item.optics.surface_i[item.hit.surface, S_KIND]) for item in asked}
    scattering = {
        entry.kind.number for entry in KINDS.entries(ours=True) if entry.kind.draw is not None
    }
    assert scattering < kinds
