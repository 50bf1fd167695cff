"""Commands of lenses and polarised light: lens-levels, lens-cone, lens-picture, microscope …"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from raymap.cli.options import Json, Panel, emit_json

if TYPE_CHECKING:
    from tracer.lens import Lens

__all__ = ["register"]

Radii = Annotated[
    tuple[float, float],
    typer.Option(help="Radii of curvature, front and back [mm]; 0 is a plane."),
]
Thickness = Annotated[float, typer.Option(help="Thickness between the vertices [mm].")]
Apertures = Annotated[
    tuple[float, float], typer.Option(help="Semi-apertures, front and back [mm].")
]
GlassName = Annotated[str, typer.Option(help="A glass by name, or a refractive index.")]
Wavelength = Annotated[float, typer.Option(help="Vacuum wavelength [nm].")]
Depth = Annotated[int, typer.Option(help="Deepest level of the trees.")]
Plot = Annotated[
    Path | None,
    typer.Option("-o", "--output", help="Write a plot; an existing file is replaced."),
]
Picture = Annotated[
    Path, typer.Option("-o", "--output", help="Picture to write; an existing one is replaced.")
]

LINE_D = 587.5618


def register(app: typer.Typer) -> None:
    """Hang the commands on the application."""
    from tracer.studies.cli_polarized_light import microscope, record_polarized

    app.command("lens-levels", rich_help_panel=Panel.STUDIES)(lens_levels)
    app.command("lens-cone", rich_help_panel=Panel.STUDIES)(lens_cone)
    app.command("lens-vignetting", rich_help_panel=Panel.STUDIES)(lens_vignetting)
    app.command("lens-picture", rich_help_panel=Panel.STUDIES)(lens_picture)
    app.command("microscope", rich_help_panel=Panel.STUDIES)(microscope)
    app.command(
        "record-polarized",
        hidden=True,
        rich_help_panel=Panel.RECORD,
        context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    )(record_polarized)


def _lens(
    radii: tuple[float, float], thickness: float, apertures: tuple[float, float], glass: str
) -> Lens:
    from tracer.lens import Glass, Lens

    front, back = (radius if radius != 0.0 else math.inf for radius in radii)
    return Lens(
        radius_front=front,
        radius_back=back,
        thickness=thickness,
        semi_aperture_front=apertures[0],
        semi_aperture_back=apertures[1],
        glass=Glass.of(glass),
    )


def lens_levels(
    radii: Radii = (50.0, -50.0),
    thickness: Thickness = 6.0,
    semi_apertures: Apertures = (12.5, 12.5),
    glass: GlassName = "N-BK7",
    wavelength: Wavelength = LINE_D,
    field: Annotated[float, typer.Option(help="Angle of the beam to the axis [deg].")] = 0.0,
    rays: Annotated[int, typer.Option(help="Rays of the beam.")] = 20_000,
    depth: Depth = 8,
    mode: Annotated[
        Literal["unpolarized", "polarized", "scalar", "schlick", "published"],
        typer.Option(help="How reflections are computed."),
    ] = "unpolarized",
    output: Plot = None,
    json: Json = False,
) -> None:
    """Show the share of a parallel beam that leaves a lens at each level of its tree."""
    import numpy as np

    from raymap.pictures.files import check_chart, write_chart
    from tracer.studies.lenses.lens_beams import parallel_beam
    from tracer.studies.lenses.levels import level_shares, shares_by_height

    if output is not None:
        check_chart(output)
    lens = _lens(radii, thickness, semi_apertures, glass)
    beam = parallel_beam(lens, rays, wavelength_nm=wavelength, field_deg=field)
    shares = level_shares(lens, beam, depth=depth, mode=mode)
    if output is not None:
        from tracer.studies.polarization_plots import plot_levels

        heights = np.linspace(0.0, lens.semi_aperture_front, 600, endpoint=False)
        by_height = shares_by_height(
            lens, heights, wavelength_nm=wavelength, depth=min(depth, 8), mode=mode
        )
        write_chart(plot_levels(shares, heights, by_height), output)
    numbers = {
        "levels": shares.share.tolist(),
        "exits_per_ray": shares.exits.tolist(),
        "glass": shares.glass,
        "rim": shares.rim,
        "remainder": shares.remainder,
        "missed": shares.missed,
        "focal_length_mm": lens.focal_length(wavelength),
    }
    if json:
        emit_json(numbers)
        return
    for level, share in enumerate(shares.share, start=1):
        typer.echo(f"level {level:2d}   {share:.9f}")
    for name in ("glass", "rim", "remainder", "missed"):
        typer.echo(f"{name:9s}  {numbers[name]:.9f}")


def lens_cone(
    radii: Radii = (50.0, -50.0),
    thickness: Thickness = 6.0,
    semi_apertures: Apertures = (12.5, 12.5),
    glass: GlassName = "N-BK7",
    wavelength: Wavelength = LINE_D,
    point: Annotated[
        tuple[float, float, float],
        typer.Option(help="Where the rays start [mm]; the front vertex is the origin."),
    ] = (0.0, 0.0, -20.0),
    depth: Depth = 6,
    output: Plot = None,
    json: Json = False,
) -> None:
    """Find the cone K of directions whose whole tree never meets the rim of a lens."""
    import numpy as np

    from raymap.pictures.files import check_chart, write_chart
    from tracer.studies.lenses.cone import axial_cone, masked_cone

    if output is not None:
        check_chart(output)
    lens = _lens(radii, thickness, semi_apertures, glass)
    mask = masked_cone(lens, point, depth=depth, wavelength_nm=wavelength)
    on_axis = point[0] == 0.0 and point[1] == 0.0
    numbers: dict[str, object] = {
        "depth": depth,
        "half_angle_deg": math.degrees(mask.half_angle),
        "share_of_aperture": float(mask.mask.sum() / _disc(mask.x, mask.y)),
    }
    if on_axis:
        cone = axial_cone(lens, -point[2], depth=depth, wavelength_nm=wavelength)
        numbers["half_angle_deg"] = math.degrees(cone.half_angle)
        numbers["intervals_deg"] = [list(np.rad2deg(pair)) for pair in cone.intervals]
    if output is not None:
        from tracer.studies.polarization_plots import plot_cones

        distances = np.linspace(0.25, 5.0, 40) * abs(point[2])
        depths = sorted({1, 2, depth})
        cones = {
            level: [
                axial_cone(lens, float(far), depth=level, wavelength_nm=wavelength, scan=500)
                for far in distances
            ]
            for level in depths
        }
        write_chart(plot_cones(distances, cones, mask), output)
    if json:
        emit_json(numbers)
        return
    for name, value in numbers.items():
        typer.echo(f"{name}: {value}")


def _disc(x: object, y: object) -> int:
    """Points of a square grid within its inscribed disc."""
    import numpy as np

    gx, gy = np.meshgrid(np.asarray(x), np.asarray(y))
    return int((gx * gx + gy * gy <= np.asarray(x)[-1] ** 2 * (1.0 + 1e-12)).sum())


def lens_vignetting(
    radii: Radii = (50.0, -50.0),
    thickness: Thickness = 6.0,
    semi_apertures: Apertures = (12.5, 12.5),
    glass: GlassName = "N-BK7",
    wavelength: Wavelength = LINE_D,
    field: Annotated[float, typer.Option(help="Largest angle to the axis [deg].")] = 40.0,
    steps: Annotated[int, typer.Option(help="Angles between 0 and the largest.")] = 21,
    rays: Annotated[int, typer.Option(help="Rays of each beam.")] = 10_000,
    depth: Depth = 6,
    output: Plot = None,
    json: Json = False,
) -> None:
    """Show what a lens loses of parallel beams on its rim, by field angle."""
    import numpy as np

    from raymap.pictures.files import check_chart, write_chart
    from tracer.lens.errors import LensError
    from tracer.studies.lenses.vignetting import vignetting

    if steps < 2 or not 0.0 < field < 90.0:
        raise LensError("field must lie between 0 and 90 degrees, steps must be 2 or more")
    if output is not None:
        check_chart(output)
    lens = _lens(radii, thickness, semi_apertures, glass)
    angles = np.linspace(0.0, field, steps)
    result = vignetting(lens, angles, wavelength_nm=wavelength, depth=depth, rays=rays)
    if output is not None:
        from tracer.studies.polarization_plots import plot_vignetting

        write_chart(plot_vignetting(result), output)
    rows = [
        {
            "field_deg": float(result.field_deg[k]),
            "transmitted": float(result.transmitted[k]),
            "flux": float(result.flux[k]),
            "rim_outside": float(result.rim_outside[k]),
            "rim_direct": float(result.rim_direct[k]),
            "rim_later": float(result.rim_later[k]),
            "rim_hits": int(result.rim_hits[k]),
        }
        for k in range(steps)
    ]
    if json:
        emit_json(rows)
        return
    typer.echo("field    transmitted  flux    rim outside  direct  later")
    for row in rows:
        typer.echo(
            f"{row['field_deg']:5.1f}°   {row['transmitted']:.4f}       {row['flux']:.4f}  "
            f"{row['rim_outside']:.4f}       {row['rim_direct']:.4f}  {row['rim_later']:.4f}"
        )


def lens_picture(
    output: Picture,
    radii: Radii = (50.0, -50.0),
    thickness: Thickness = 9.0,
    semi_apertures: Apertures = (16.0, 16.0),
    glass: GlassName = "N-SF11",
    color: Annotated[
        Literal["spectral", "rgb"], typer.Option(help="Wavelengths, or three channels, one index.")
    ] = "spectral",
    rules: Annotated[
        Literal["fresnel", "schlick"], typer.Option(help="Exact, or Schlick's approximation.")
    ] = "fresnel",
    analyser: Annotated[
        float | None, typer.Option(help="Analyser before the camera, angle from x [deg].")
    ] = None,
    pixels: Annotated[int, typer.Option(help="Pixels along each side.")] = 200,
    depth: Depth = 4,
) -> None:
    """Paint a board of squares seen through a lens."""
    from raymap.optics.colorimetry import encode_srgb
    from raymap.pictures.files import check_pixels, write_pixels
    from tracer.studies.lenses.lens_pictures import LensCamera
    from tracer.studies.lenses.lens_pictures import lens_picture as render

    check_pixels(output)
    lens = _lens(radii, thickness, semi_apertures, glass)
    camera = LensCamera(eye=(0.0, 0.0, -70.0), half_angle_deg=15.0, pixels=pixels)
    picture = render(
        lens, camera=camera, color=color, rules=rules, analyser_deg=analyser, depth=depth
    )
    write_pixels(output, encode_srgb(picture))
    typer.echo(f"wrote {output}")
