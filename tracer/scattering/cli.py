"""Commands of the volume-scattering studies: fit-scattering, goniophotometer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from raymap.cli.options import Json, Panel, emit_json, warnings_on_stderr
from raymap.model.doubt import FOOTNOTE, marked, with_doubts
from raymap.model.extras import require
from raymap.model.replacing import check_folder

if TYPE_CHECKING:
    from tracer.scattering.fits.fit_material import MaterialFit
    from tracer.scattering.plates.medium import ScatteringMedium

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Hang the commands on the application."""
    app.command("fit-scattering", rich_help_panel=Panel.STUDIES)(fit_scattering)
    app.command("goniophotometer", rich_help_panel=Panel.STUDIES)(goniophotometer)


def fit_scattering(
    data: Annotated[Path, typer.Argument(help="A measurement file (TOML).", show_default=False)],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Folder for material file, table, report, plots; existing ones are replaced.",
        ),
    ] = None,
    gamma: Annotated[
        float | None, typer.Option(help="Hold the exponent of the phase function at this value.")
    ] = None,
    monte_carlo: Annotated[
        float | None,
        typer.Option(help="Also fit this wavelength [nm] by Monte Carlo, as published."),
    ] = None,
    rays: Annotated[
        int, typer.Option(min=100, help="Rays per plate and angle, for --monte-carlo.")
    ] = 10_000,
    evaluations: Annotated[
        int, typer.Option(min=10, help="Evaluations of the objective, for --monte-carlo.")
    ] = 40,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 1,
    json: Json = False,
) -> None:
    """Find mean free path, absorption and phase function from measured plates."""
    from tracer.scattering.fits.fit_material import fit_material, wavelength_problem
    from tracer.scattering.fits.identifiability import sensitivity
    from tracer.scattering.fits.statements import describe_fit
    from tracer.scattering.fits.surface import surface_tilt
    from tracer.scattering.measured.datafile import load_measurement

    if output is not None:
        require("matplotlib")
        check_folder(output)
    with warnings_on_stderr():
        measurement, settings = load_measurement(data)
    if gamma is not None:
        settings = settings.model_copy(update={"gamma": gamma})
    if monte_carlo is not None and monte_carlo not in measurement.wavelengths_nm:
        known = f"{measurement.wavelengths_nm[0]:g} .. {measurement.wavelengths_nm[-1]:g} nm"
        raise typer.BadParameter(f"{monte_carlo:g} nm was not measured; there is {known}")
    say = (lambda _: None) if json else (lambda line: typer.echo(line, err=True))
    fit = fit_material(measurement, settings, progress=say)
    averaged = wavelength_problem(measurement.average(), settings, 0.0)
    face = surface_tilt(measurement, fit)
    report = describe_fit(fit, sensitivity(averaged, fit.average.medium))
    if face.slopes.size:
        report.append(f"Faces: rms slope {face.rms_slope:.3f} from the BRDF.")
    traced: dict[str, Any] = {}
    if monte_carlo is not None:
        traced = _monte_carlo(measurement, settings, fit, monte_carlo, rays, evaluations, seed)
        report.append(traced["sentence"])
    files = _write_results(output, fit, report) if output is not None else []
    if json:
        emit_json(_summary(fit, report, face.rms_slope, traced, files))
        return
    for line in report:
        typer.echo(line)
    for name in files:
        typer.echo(f"wrote {name}")


def _monte_carlo(
    measurement: Any,
    settings: Any,
    fit: MaterialFit,
    wavelength: float,
    rays: int,
    evaluations: int,
    seed: int,
) -> dict[str, Any]:
    from tracer.scattering.fits.fit_material import wavelength_problem
    from tracer.scattering.fits.fit_mc import fit_monte_carlo

    start = next(f for f in fit.wavelengths if f.wavelength_nm == wavelength)
    problem = wavelength_problem(measurement, settings, wavelength)
    found = fit_monte_carlo(problem, start.medium, rays=rays, seed=seed, evaluations=evaluations)
    medium = found.medium
    sentence = (
        f"Monte Carlo at {wavelength:g} nm ({len(found.log)} evaluations, {rays} rays per plate "
        f"and angle, {found.seconds:.1f} s): mu_s' = {medium.reduced_scattering_per_mm:.4g} per "
        f"mm, p = {medium.absorption_per_mm:.4g} per mm, g = {medium.g:.3f}; objective "
        f"{found.objective:.5f}, its noise {found.noise:.5f} (exact fit: {start.objective:.5f})."
    )
    return {
        "sentence": sentence,
        "wavelength_nm": wavelength,
        **_values(medium),
        "objective": found.objective,
        "objective_noise": found.noise,
        "evaluations": len(found.log),
        "seconds": found.seconds,
    }


def _values(medium: ScatteringMedium) -> dict[str, float]:
    return {
        "reduced_scattering_per_mm": medium.reduced_scattering_per_mm,
        "absorption_per_mm": medium.absorption_per_mm,
        "mean_free_path_mm": medium.mean_free_path_mm,
        "g": medium.g,
    }


def _summary(
    fit: MaterialFit, report: list[str], rms_slope: float, traced: dict[str, Any], files: list[str]
) -> dict[str, Any]:
    spectrum = []
    for free, profile, common in zip(fit.wavelengths, fit.profiles, fit.common, strict=True):
        row: dict[str, Any] = {"wavelength_nm": free.wavelength_nm, **_values(free.medium)}
        row["intervals"] = {k: [i.low, i.high] for k, i in profile.intervals.items()}
        row |= {"rms": free.rms, "bounds": list(free.bounds), "with_one_g": _values(common.medium)}
        spectrum.append(row)
    gammas = fit.gamma_profile
    return {
        "name": fit.name,
        "index": fit.index,
        "gamma": fit.gamma,
        "gamma_profile": None
        if gammas is None
        else {"gamma": gammas.gammas.tolist(), "chi2": gammas.chi2.tolist()},
        "g": fit.g,
        "average": _values(fit.average.medium),
        "average_intervals": {k: [i.low, i.high] for k, i in fit.average_profile.intervals.items()},
        "wavelengths": spectrum,
        "rms_slope": rms_slope,
        "monte_carlo": {k: v for k, v in traced.items() if k != "sentence"} or None,
        "statements": report,
        "files": files,
        "seconds": fit.seconds,
    }


def _write_results(folder: Path, fit: MaterialFit, report: list[str]) -> list[str]:
    from tracer.scattering.fits.material_file import material_toml, result_csv, write_result
    from tracer.scattering.plots import plot_measured, plot_parameters

    folder.mkdir(parents=True, exist_ok=True)
    stem = "".join(c if c.isalnum() else "_" for c in fit.name)
    texts = {
        f"{stem}.material.toml": material_toml(fit),
        f"{stem}.fit.csv": result_csv(fit),
        f"{stem}.report.txt": "\n".join(report) + "\n",
    }
    for name, text in texts.items():
        write_result(folder / name, text)
    pictures = {
        f"{stem}.parameters.png": plot_parameters,
        f"{stem}.measured.png": plot_measured,
    }
    for name, plot in pictures.items():
        plot(fit, folder / name)
    return [str(folder / name) for name in (*texts, *pictures)]


def goniophotometer(
    material: Annotated[
        Path, typer.Argument(help="A file with [media.NAME] tables.", show_default=False)
    ],
    thickness: Annotated[float, typer.Option(help="Thickness of the plate [mm].")],
    medium: Annotated[
        str | None, typer.Option(help="Name of the medium; the first scattering one otherwise.")
    ] = None,
    incidence: Annotated[
        list[float] | None, typer.Option(help="Angle of incidence [deg]; repeatable.")
    ] = None,
    wavelength: Annotated[
        list[float] | None, typer.Option(help="Wavelength [nm]; repeatable.")
    ] = None,
    rays: Annotated[int, typer.Option(min=40, help="Rays per angle and wavelength.")] = 200_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 1,
    rms_slope: Annotated[
        float, typer.Option(min=0, help="Root mean square slope of both faces.")
    ] = 0.0,
    weighted: Annotated[
        bool, typer.Option("--weighted", help="Use the weighted estimator.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Folder for tables and plots; existing ones are replaced."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Light a plate of a scattering medium and measure BRDF, BTDF, R and T."""
    from tracer.scattering.plates.goniophotometer import measure_plate
    from tracer.scattering.plates.medium_file import load_media
    from tracer.scattering.plates.tilt import gaussian_tilt

    if output is not None:
        require("matplotlib")
        check_folder(output)
    face = gaussian_tilt(rms_slope)
    media = load_media(material, medium, wavelength or [550.0])
    lights = [
        measure_plate(
            volume,
            thickness,
            angle,
            rays=rays,
            seed=seed,
            weighted=weighted,
            front=face,
            back=face,
            wavelength_nm=nm,
        )
        for nm, volume in media.items()
        for angle in (incidence or [0.0])
    ]
    rows = [
        with_doubts(
            {
                "wavelength_nm": light.wavelength_nm,
                "incidence_deg": light.incidence_deg,
                "reflectance": light.reflectance,
                "reflectance_se": light.reflectance_se,
                "transmittance": light.transmittance,
                "transmittance_se": light.transmittance_se,
                "absorbed": light.absorbed,
                "scatterings": light.scatterings,
            }
        )
        for light in lights
    ]
    files = _write_goniograms(output, lights) if output is not None else []
    if json:
        emit_json({"rays": rays, "seed": seed, "measurements": rows, "files": files})
        return
    for row in rows:
        r, r_se = row["reflectance"], row["reflectance_se"]
        t, t_se = row["transmittance"], row["transmittance_se"]
        typer.echo(
            f"{row['wavelength_nm']:g} nm, {row['incidence_deg']:g}°: "
            f"R = {marked(f'{r:.4f} ± {r_se:.4f}', r, r_se)}, "
            f"T = {marked(f'{t:.4f} ± {t_se:.4f}', t, t_se)}, "
            f"absorbed {row['absorbed']:.4f}, {row['scatterings']:.1f} scatterings a ray"
        )
    if any(row["doubtful"] for row in rows):
        typer.echo(FOOTNOTE)
    for name in files:
        typer.echo(f"wrote {name}")


def _write_goniograms(folder: Path, lights: list[Any]) -> list[str]:
    from tracer.scattering.fits.material_file import goniogram_csv, write_result
    from tracer.scattering.plots import plot_goniogram, plot_spectrum

    folder.mkdir(parents=True, exist_ok=True)
    names = []
    for light in lights:
        stem = f"{light.wavelength_nm:g}nm_{light.incidence_deg:g}deg"
        write_result(folder / f"{stem}.csv", goniogram_csv(light))
        plot_goniogram(light, folder / f"{stem}.png")
        names += [str(folder / f"{stem}.csv"), str(folder / f"{stem}.png")]
    if len({light.wavelength_nm for light in lights}) > 1:
        first = lights[0].incidence_deg
        plot_spectrum(
            [light for light in lights if light.incidence_deg == first],
            folder / "spectrum.png",
            title=f"incidence {first:g}°",
        )
        names.append(str(folder / "spectrum.png"))
    return names
