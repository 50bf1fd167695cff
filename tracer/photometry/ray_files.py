"""Ray files as sources: from `raymap.rayfiles` to a list of rays that a scene emits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from raymap import rayfiles
from raymap.model.errors import SceneError
from raymap.optics.colorimetry import xyz_to_linear_srgb
from raymap.rayfiles import RAY_FORMATS, FluxFrom, RayFileError, RaySet
from tracer.light import LightFormat, RayList

__all__ = ["read"]


def read(path: Path, flux_from: FluxFrom = "header") -> RayList:
    """The rays of a TM-25 or Zemax file.

    Where the header states another flux than the rays carry, ``flux_from`` says what counts.

    Rays with tristimulus values keep the colour that these look like. Rays that share a spectrum
    get one wavelength each, spread evenly over the spectrum's power, in
    an order that is the same whenever the file is read.

    Raises
    ------
    SceneError
        The file is no sound ray file.
    """
    try:
        rays = rayfiles.read(path, flux_from=flux_from)
    except RayFileError as error:
        raise SceneError(str(error)) from None
    return RayList(
        positions=rays.position,
        directions=rays.direction,
        flux=rays.flux.astype(np.float64),
        wavelength_nm=_wavelengths(rays),
        rgb=None if rays.tristimulus is None else xyz_to_linear_srgb(rays.tristimulus),
        unit=rays.flux_unit,
        length_unit=rays.length_unit,
        name=path.name,
    )


def _wavelengths(rays: RaySet) -> NDArray[np.float64] | None:
    if rays.wavelength_nm is not None:
        return rays.wavelength_nm.astype(np.float64)
    if not rays.spectra:
        return None
    n = len(rays)
    wavelength = np.empty(n)
    owner = np.zeros(n, np.int32) if rays.spectrum is None else rays.spectrum
    # Shuffle, so that neighbouring rays of the file differ in colour
    level = (np.random.default_rng(0).permutation(n) + 0.5) / n
    for number, spectrum in enumerate(rays.spectra):
        mine = owner == number
        wavelength[mine] = _quantiles(
            spectrum.wavelength_nm.astype(np.float64),
            spectrum.power.astype(np.float64),
            level[mine],
        )
    return wavelength


def _quantiles(
    nm: NDArray[np.float64], power: NDArray[np.float64], level: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Wavelengths below which the given shares of the power lie, the power linear in between."""
    if len(nm) == 1 or not power.sum() > 0:
        return np.full(len(level), nm[0])
    order = np.argsort(nm)
    fine = np.linspace(nm[order[0]], nm[order[-1]], 4096)
    shares = np.interp(fine, nm[order], power[order])
    running = np.concatenate([[0.0], np.cumsum(0.5 * (shares[1:] + shares[:-1]))])
    return np.asarray(np.interp(level * running[-1], running, fine))


KINDS = tuple(
    LightFormat(
        suffixes=kind.suffixes,
        title=kind.title,
        place=30 + kind.place,
        sniff=kind.sniff,
        read=read,
    )
    for kind in RAY_FORMATS.kinds()
)
"""Every format of ray files, those of other distributions too."""
