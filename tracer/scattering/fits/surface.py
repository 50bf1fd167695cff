"""Tilts of the plates' faces from what the volume leaves unexplained in their BRDF."""

from __future__ import annotations

import numpy as np

from tracer.scattering.fits.fit_material import MaterialFit
from tracer.scattering.measured.measurement import MaterialMeasurement
from tracer.scattering.plates.plate_bsdf import plate_bsdf
from tracer.scattering.plates.tilt import SMOOTH, TiltDistribution, tilt_from_brdf

__all__ = ["surface_tilt"]

_STANDS_OUT = 2.5


def surface_tilt(measurement: MaterialMeasurement, fit: MaterialFit) -> TiltDistribution:
    """Tilt distribution of the faces, averaged over all BRDF tables of a material.

    A value counts where it exceeds the BRDF of a smooth plate of the fitted medium by more than
    2.5 of its standard errors; elsewhere the face adds nothing that the data show. Tables at the
    smallest angle of incidence are used, usually 10 degrees, where facets are least in each
    other's way.
    """
    tables = [table for table in measurement.scatter if table.side == "brdf"]
    incidences = [float(i) for table in tables for i in np.unique(table.incidence_deg) if i > 0.0]
    if not incidences:
        return SMOOTH
    incidence = min(incidences)
    tables = [table for table in tables if np.isclose(table.incidence_deg, incidence).any()]
    theta, phi, surface = [], [], []
    for table in tables:
        rows = np.isclose(table.incidence_deg, incidence)
        for wavelength in np.unique(table.wavelength_nm[rows]):
            if np.isnan(wavelength):
                # Averaged over the visible, as the fit of averages is
                chosen, nearest = rows & np.isnan(table.wavelength_nm), fit.average
            else:
                chosen = rows & (table.wavelength_nm == wavelength)
                nearest = min(fit.common, key=lambda f: abs(f.wavelength_nm - wavelength))
            polar, at_polar = np.unique(table.theta_deg[chosen], return_inverse=True)
            turn, at_turn = np.unique(table.phi_deg[chosen], return_inverse=True)
            smooth = plate_bsdf(nearest.medium, table.thickness_mm, incidence, polar, turn).brdf
            volume = smooth[at_polar.ravel(), at_turn.ravel()]
            excess = table.value[chosen] - volume
            noise = table.error[chosen] * np.maximum(table.value[chosen], volume)
            theta.append(table.theta_deg[chosen])
            phi.append(table.phi_deg[chosen])
            surface.append(np.where(excess > _STANDS_OUT * noise, excess, 0.0))
    return tilt_from_brdf(
        incidence,
        np.concatenate(theta),
        np.concatenate(phi),
        np.concatenate(surface),
        index=measurement.index,
    )
