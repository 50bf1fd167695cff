"""Laws of scatter against the specular light that they take their share from."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from raymap.laws.radial import scatter_share
from raymap.model.errors import SceneError
from tracer.compiled import (
    B_MEDIUM,
    DIELECTRIC,
    F_INSIDE,
    F_OUTSIDE,
    F_SURFACE,
    MIRROR,
    S_KIND,
    S_OWN,
    S_OWN_SIZE,
    S_SCATTER,
    S_STRIDE,
    WORLD,
    CompiledScene,
)
from tracer.surfaces.interaction import Interface, optics_of
from tracer.surfaces.law import check_law
from tracer.surfaces.specular import specular_share
from tracer.surfaces.surface import Surface

__all__ = ["check_laws", "check_scatter"]

_LARGEST = 85
"""Angle up to which the law must be met [deg]: towards 90 degrees nothing is transmitted."""


def check_scatter(
    scene: CompiledScene, surfaces: Sequence[str], channels: Sequence[str], origin: str
) -> None:
    """Refuse laws that scatter more than the specular light of the faces that have them.

    A law is the BSDF itself. What it scatters in reflection, TIS(θ) = ∫ BSDF cos θ dΩ about the
    reflected ray, is taken from the specular reflectance R(θ); in transmission, about the refracted
    ray, from T(θ). Both must hold at every whole angle up to 85 degrees on either side.

    Parameters
    ----------
    scene : faces with the media of the bodies behind and before them
    surfaces, channels : names, for messages
    origin : names the scene

    Raises
    ------
    SceneError
        names the surface, the angle, the channel, and both shares
    """
    kind, table = scene.surface_i[:, S_KIND], scene.surface_i[:, S_SCATTER]
    lawful = (table >= 0) & np.isin(kind, (MIRROR, DIELECTRIC))
    for surface, medium, other in _sides(scene, lawful):
        where = f"{origin}: surfaces.{surfaces[surface]}.scatter"
        _check(scene, surface, medium, other, channels, where)


def check_laws(scene: CompiledScene, surfaces: Sequence[tuple[str, Surface]], origin: str) -> None:
    """Refuse surfaces whose `Law` sends on more light than arrives at the faces that have them.

    Raises
    ------
    SceneError
        see `tracer.surfaces.law.check_law`
    """
    laws = [surface.law for _, surface in surfaces]
    for number, medium, other in _sides(scene, np.array([law is not None for law in laws])):
        law = laws[number]
        assert law is not None
        assert scene.tables is not None
        first, size = scene.surface_i[number, [S_OWN, S_OWN_SIZE]].tolist()
        check_law(
            law,
            scene.tables[first : first + max(size, 0)],
            float(scene.medium_f[medium, 0]),
            float(scene.medium_f[other, 0]),
            scene.n_channels,
            f"{origin}: surfaces.{surfaces[number][0]}",
        )


def _sides(scene: CompiledScene, wanted: NDArray[np.bool_]) -> Iterator[tuple[int, int, int]]:
    """Surfaces that faces have, with the media of light and beyond, from either side."""
    if scene.tables is None or not wanted.any():
        return
    # The media on both sides of each face, the world's where there is no body
    media = np.append(scene.body_i[:, B_MEDIUM], scene.limits[WORLD])
    sides = media[scene.face_i[:, [F_INSIDE, F_OUTSIDE]]]
    rows = np.column_stack([scene.face_i[:, F_SURFACE], sides])
    rows = np.unique(rows[wanted[scene.face_i[:, F_SURFACE]]], axis=0)
    for surface, inside, outside in rows.tolist():
        yield surface, inside, outside
        yield surface, outside, inside


def _check(
    scene: CompiledScene, surface: int, medium: int, other: int, channels: Sequence[str], where: str
) -> None:
    """Check a surface for light in ``medium`` with ``other`` beyond it."""
    tables = scene.tables
    assert tables is not None
    first, stride = scene.surface_i[surface, [S_SCATTER, S_STRIDE]].tolist()
    mirror = scene.surface_i[surface, S_KIND] == MIRROR
    optics = optics_of.py_func(scene)  # type: ignore[attr-defined]
    grazing = math.sin(math.radians(_LARGEST))
    for k, channel in enumerate(channels):
        ratio = float(scene.medium_f[medium, k] / scene.medium_f[other, k])
        for crosses in (False,) if mirror else (False, True):
            for angle in range(_LARGEST + 1):
                sine = math.sin(math.radians(angle))
                beta = sine * ratio if crosses else sine
                if beta > grazing:
                    break
                at = Interface(surface, medium, other, math.cos(math.radians(angle)))
                share = specular_share(optics, at, crosses, k)
                scattered = scatter_share(tables, first + k * stride, beta)
                if scattered > share * (1.0 + 1e-9):
                    does, what, key = (
                        ("transmits", "transmission", "transmittance")
                        if crosses
                        else ("reflects", "reflection", "reflectance")
                    )
                    raise SceneError(
                        f"{where}: its law scatters {scattered:.4g} of the light in {what} at "
                        f"{angle} degrees in channel {channel}, where the surface {does} "
                        f"{share:.4g} in all; lower the law's amplitude, or raise the {key}"
                    )
