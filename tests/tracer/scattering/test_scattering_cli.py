"""The commands: a fit from files to a material that a scene reads, and its measurement."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from raymap.model.errors import RayMapError
from tests.tracer.scattering.synthetic import CLEAR, flux_table
from tracer.scattering.cli import register
from tracer.scattering.plates.medium_file import load_media
from tracer.scene.load import parse_scene

APP = typer.Typer()
register(APP)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("opal")
    flux = flux_table(CLEAR, (1.0, 3.0), angles=(0.0, 30.0))
    with (folder / "plates.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["thickness_mm", "wavelength_nm", "incidence_deg", "R", "T"])
        for wavelength in (500.0, 600.0):
            for k in range(len(flux)):
                writer.writerow(
                    [
                        flux.thickness_mm[k],
                        wavelength,
                        flux.incidence_deg[k],
                        flux.reflectance[k],
                        flux.transmittance[k],
                    ]
                )
    path = folder / "opal.toml"
    path.write_text('name = "opal"\n[fit]\ngamma = 10.0\n[[plate]]\nflux = "plates.csv"\n')
    return path


def test_fit_writes_a_material_that_scenes_and_the_goniophotometer_read(
    data: Path, tmp_path: Path
) -> None:
    run = CliRunner().invoke(APP, ["fit-scattering", str(data), "-o", str(tmp_path), "--json"])
    assert run.exit_code == 0, run.output
    result = json.loads(run.stdout)
    assert result["gamma"] == 10.0
    assert result["average"]["reduced_scattering_per_mm"] == pytest.approx(
        CLEAR.reduced_scattering_per_mm, rel=0.02
    )
    assert result["average"]["absorption_per_mm"] == pytest.approx(0.01, rel=0.05)
    assert len(result["wavelengths"]) == 2
    assert any("mu_s'" in line for line in result["statements"])
    names = {Path(name).name for name in result["files"]}
    assert names == {
        "opal.material.toml",
        "opal.fit.csv",
        "opal.report.txt",
        "opal.parameters.png",
        "opal.measured.png",
    }
    assert all((tmp_path / name).stat().st_size > 0 for name in names)
    # The material is a medium of a scene, and a plate of it measures as the fit says
    text = (tmp_path / "opal.material.toml").read_text()
    scene = parse_scene('length_unit = "mm"\n[sources.lamp]\nkind = "point"\n' + text)
    assert "opal" in scene.media
    (medium,) = load_media(tmp_path / "opal.material.toml", None, [550.0]).values()
    assert medium.gamma == 10.0
    assert medium.reduced_scattering_per_mm == pytest.approx(
        CLEAR.reduced_scattering_per_mm, rel=0.05
    )
    seen = CliRunner().invoke(
        APP,
        ["goniophotometer", str(tmp_path / "opal.material.toml"), "--thickness", "1",
         "--wavelength", "550", "--rays", "2000", "-o", str(tmp_path / "seen"), "--json"],
    )  # fmt: skip
    assert seen.exit_code == 0, seen.output
    (row,) = json.loads(seen.stdout)["measurements"]
    assert row["reflectance"] + row["transmittance"] + row["absorbed"] == pytest.approx(1.0)
    assert (tmp_path / "seen" / "550nm_0deg.png").exists()


def test_bad_data_are_one_clear_line(data: Path, tmp_path: Path) -> None:
    (tmp_path / "plates.csv").write_text(
        (data.parent / "plates.csv").read_text() + "3.0,600,0,0.7,0.6\n"
    )
    (tmp_path / "opal.toml").write_text(data.read_text())
    run = CliRunner().invoke(APP, ["fit-scattering", str(tmp_path / "opal.toml")])
    assert isinstance(run.exception, RayMapError)
    assert "plates.csv, line 10: R + T exceeds 1" in str(run.exception)


def test_a_medium_that_is_not_there(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text("[media.glass]\nindex = 1.5\n")
    run = CliRunner().invoke(APP, ["goniophotometer", str(path), "--thickness", "1"])
    assert "no scattering medium" in str(run.exception)
