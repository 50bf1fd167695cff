"""Write the measurement files of two opal materials, three plates each, and the truth beside them.

The materials are invented, but look like opal acrylic: A is dense and nearly grey, B is clearer,
peaks forward and absorbs blue. The exact model makes all values; then every value gets an
independent relative error, 6 % for R and T, 10 % for scattering distributions. The faces have a
slight roughness that shows in the BRDF near the specular reflection only.

Run: python samples/opal/make_data.py
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from raymap.optics.fresnel import reflectance_column
from tracer.scattering.plates.medium import ScatteringMedium
from tracer.scattering.plates.plate_bsdf import plate_bsdf
from tracer.scattering.plates.plate_exact import ExactPlates
from tracer.scattering.plates.tilt import gaussian_tilt

HERE = Path(__file__).parent
WAVELENGTHS = np.arange(430.0, 701.0, 10.0)
ANGLES = (0.0, 10.0, 20.0, 30.0, 45.0, 60.0)
SECTION = (0.0, 3.0, 6.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
INDEX = 1.49
FLUX_ERROR, SCATTER_ERROR, RMS_SLOPE = 0.06, 0.1, 0.06
PLATES = {"a": (1.53, 1.98, 3.15), "b": (2.05, 3.06, 3.63)}
GAMMA = {"a": 2.5, "b": 10.0}


def truth(material: str, wavelength_nm: float) -> ScatteringMedium:
    """The medium that was measured."""
    s = (wavelength_nm - 430.0) / 270.0
    if material == "a":
        m, g = 0.054 + 0.012 * s, 0.52 - 0.05 * s
        p = 0.007 + 0.006 * math.exp(-5.0 * s) + 0.002 * math.exp(-(((s - 0.75) / 0.12) ** 2))
    else:
        m, g = 0.26 + 0.18 * s, 0.38 - 0.06 * s
        p = 0.005 + 0.028 * math.exp(-4.0 * s)
    return ScatteringMedium(
        mean_free_path_mm=m, absorption_per_mm=p, g=g, gamma=GAMMA[material], index=INDEX
    )


def main() -> None:
    for number, material in enumerate(PLATES):
        random = np.random.default_rng(2018 + number)
        write_truth(material)
        write_fluxes(material, random)
        write_sections(material, random)
        write_reflections(material, random)


def noisy(value: float, error: float, random: np.random.Generator) -> str:
    return f"{value * (1.0 + error * random.standard_normal()):.5f}"


def table(name: str, header: str, rows: list[list[str]]) -> None:
    with (HERE / name).open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header.split())
        writer.writerows(rows)


def write_truth(material: str) -> None:
    rows = []
    for wavelength in WAVELENGTHS:
        medium = truth(material, wavelength)
        rows.append(
            [
                f"{wavelength:g}",
                f"{medium.mean_free_path_mm:.6f}",
                f"{medium.absorption_per_mm:.6f}",
                f"{medium.g:.5f}",
                f"{medium.gamma:g}",
                f"{medium.reduced_scattering_per_mm:.6f}",
            ]
        )
    header = "wavelength_nm mean_free_path_mm absorption_per_mm g gamma reduced_scattering_per_mm"
    table(f"truth_{material}.csv", header, rows)


def write_fluxes(material: str, random: np.random.Generator) -> None:
    solver = ExactPlates(index=INDEX, incidence_deg=ANGLES, nodes=32)
    plates = PLATES[material]
    rows: dict[float, list[list[str]]] = {plate: [] for plate in plates}
    for wavelength in WAVELENGTHS:
        out = solver.solve(truth(material, wavelength), plates)
        for i, plate in enumerate(plates):
            for k, angle in enumerate(ANGLES):
                rows[plate].append(
                    [
                        f"{wavelength:g}",
                        f"{angle:g}",
                        noisy(out.reflectance[i, k], FLUX_ERROR, random),
                        noisy(out.transmittance[i, k], FLUX_ERROR, random),
                    ]
                )
    for plate in plates:
        table(f"{material}_{plate}_flux.csv", "wavelength_nm incidence_deg R T", rows[plate])


def write_sections(material: str, random: np.random.Generator) -> None:
    """BTDF at normal incidence: the thinnest plate at all wavelengths, the others at 550 nm."""
    for i, plate in enumerate(PLATES[material]):
        rows = []
        for wavelength in WAVELENGTHS if i == 0 else (550.0,):
            light = plate_bsdf(truth(material, wavelength), plate, 0.0, SECTION)
            for theta, value in zip(SECTION, light.btdf[:, 0], strict=True):
                rows.append(
                    [f"{wavelength:g}", "0", f"{theta:g}", "0", noisy(value, SCATTER_ERROR, random)]
                )
        header = "wavelength_nm incidence_deg theta_deg phi_deg btdf"
        table(f"{material}_{plate}_btdf.csv", header, rows)


def write_reflections(material: str, random: np.random.Generator) -> None:
    """BRDF at 10 degrees and 550 nm, with the facets of the faces."""
    incidence = 10.0
    theta = np.concatenate((np.arange(0.0, 30.0, 1.0), np.arange(30.0, 81.0, 5.0)))
    phi = np.array([0.0, 45.0, 90.0, 135.0, 180.0])
    face = gaussian_tilt(RMS_SLOPE)
    to_light = np.array(
        [-math.sin(math.radians(incidence)), 0.0, math.cos(math.radians(incidence))]
    )
    for plate in PLATES[material]:
        volume = plate_bsdf(truth(material, 550.0), plate, incidence, theta, phi).brdf
        rows = []
        for i, t in enumerate(np.radians(theta)):
            for k, f in enumerate(np.radians(phi)):
                to_eye = np.array(
                    [math.sin(t) * math.cos(f), math.sin(t) * math.sin(f), math.cos(t)]
                )
                half = (to_light + to_eye) / np.linalg.norm(to_light + to_eye)
                tilt = math.degrees(math.acos(min(1.0, half[2])))
                density = np.interp(tilt, face.theta_deg, face.density, right=0.0)
                fresnel = reflectance_column(1.0, INDEX, np.array([half @ to_light]))[0]
                surface = fresnel * density / (4.0 * to_light[2] * max(0.05, to_eye[2]))
                value = noisy(volume[i, k] + surface, SCATTER_ERROR, random)
                rows.append(["550", f"{incidence:g}", f"{theta[i]:g}", f"{phi[k]:g}", value])
        header = "wavelength_nm incidence_deg theta_deg phi_deg brdf"
        table(f"{material}_{plate}_brdf.csv", header, rows)


if __name__ == "__main__":
    main()
