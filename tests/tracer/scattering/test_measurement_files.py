"""Reading measurements: tables, units, other formats, and messages that name the row."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from tracer.scattering.measured.bsdf_xml import read_bsdf_xml
from tracer.scattering.measured.datafile import load_measurement
from tracer.scattering.measured.measurement import MeasurementError
from tracer.scattering.measured.tables import read_scatter_astm, read_scatter_csv

SAMPLES = Path(__file__).parents[3] / "samples" / "opal"
GOOD = [(550, a, r, t) for a, r, t in ((0, 0.29, 0.63), (10, 0.295, 0.62), (30, 0.31, 0.6))]


def write(folder: Path, rows: list[tuple[object, ...]], *, head: str = "", plate: str = "") -> Path:
    lines = ["wavelength_nm,incidence_deg,R,T", *(",".join(map(str, row)) for row in rows)]
    (folder / "plate.csv").write_text("\n".join(lines) + "\n")
    thickness = plate or "thickness = 2.05"
    (folder / "data.toml").write_text(
        f'name = "x"\n{head}\n[[plate]]\n{thickness}\nflux = "plate.csv"\n'
    )
    return folder / "data.toml"


def test_samples_are_read() -> None:
    for letter, plates in (("a", [1.53, 1.98, 3.15]), ("b", [2.05, 3.06, 3.63])):
        material, settings = load_measurement(SAMPLES / f"opal_{letter}.toml")
        np.testing.assert_allclose(material.plates_mm, plates)
        assert material.wavelengths_nm.size == 28
        assert len(material.flux) == 3 * 28 * 6
        assert {table.side for table in material.scatter} == {"brdf", "btdf"}
        section = material.thinnest_section(550.0)
        assert section is not None
        assert section[0].size == 13
        assert material.average().wavelengths_nm.tolist() == [0.0]
        assert settings.gamma == "search"


def test_units_are_converted(tmp_path: Path) -> None:
    rows: list[tuple[object, ...]] = [(w / 1000, a, 100 * r, 100 * t) for w, a, r, t in GOOD]
    head = '[units]\nflux = "percent"\nwavelength = "um"\nthickness = "um"'
    material, _ = load_measurement(write(tmp_path, rows, head=head, plate="thickness = 2050"))
    np.testing.assert_allclose(material.flux.reflectance, [0.29, 0.295, 0.31])
    np.testing.assert_allclose(material.flux.wavelength_nm, 550.0)
    np.testing.assert_allclose(material.plates_mm, 2.05)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ((550, 20, 0.6, 0.5), r"plate\.csv, line 5: R \+ T exceeds 1"),
        ((550, 20, 29.0, 63.0), r"line 5: R or T looks like percent"),
        ((0.55, 20, 0.3, 0.6), r"line 5: .*micrometres"),
        ((550, "", 0.3, 0.6), r"line 5: the angle of incidence is missing"),
        ((550, 95, 0.3, 0.6), r"line 5: the angle of incidence is missing or outside"),
        ((550, 20, "", ""), r"line 5: neither R nor T"),
        ((550, 20, -0.1, 0.6), r"line 5: R and T must be > 0"),
        (("", 20, 0.3, 0.6), r"line 5: the wavelength is missing"),
        ((550, 20, "much", 0.6), r"line 5: 'much' is not a number"),
        ((550, 20, 0.3), r"line 5: 3 cells, the header has 4"),
    ],
)
def test_bad_rows_are_named(tmp_path: Path, row: tuple[object, ...], message: str) -> None:
    with pytest.raises(MeasurementError, match=message):
        load_measurement(write(tmp_path, [*GOOD, row]))


def test_bad_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="no thickness"):
        load_measurement(write(tmp_path, list(GOOD), plate="# none"))
    with pytest.raises(MeasurementError, match="mixed units"):
        load_measurement(write(tmp_path, list(GOOD), plate="thickness = 2050"))
    with pytest.raises(MeasurementError, match=r"fit\.gammma"):
        load_measurement(write(tmp_path, list(GOOD), head="[fit]\ngammma = 2"))
    (tmp_path / "bad.toml").write_text("name = [")
    with pytest.raises(MeasurementError, match="not a TOML"):
        load_measurement(tmp_path / "bad.toml")
    with pytest.raises(MeasurementError, match="there is no measurement file"):
        load_measurement(tmp_path / "nothing.toml")
    (tmp_path / "none.csv").write_text("wavelength_nm,incidence_deg\n550,0\n")
    (tmp_path / "data.toml").write_text('name="x"\n[[plate]]\nthickness=1\nflux="none.csv"\n')
    with pytest.raises(MeasurementError, match="column R or T"):
        load_measurement(tmp_path / "data.toml")


def test_noise_above_one_is_allowed_on_request(tmp_path: Path) -> None:
    rows: list[tuple[object, ...]] = [*GOOD, (550, 20, 0.4, 0.65)]
    material, _ = load_measurement(write(tmp_path, rows, head="energy_tolerance = 0.1"))
    assert len(material.flux) == 4


def test_scatter_tables_name_bad_lines(tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    path.write_text("incidence_deg,theta_deg,btdf\n0,0,0.2\n0,100,0.1\n")
    with pytest.raises(MeasurementError, match=r"s\.csv, line 3"):
        read_scatter_csv(path, 1.0, error=0.1)


def test_astm_file(tmp_path: Path) -> None:
    path = tmp_path / "sample.astm"
    path.write_text(
        "SOURCE laser\nWAVELENGTH 0.6328\nNUM_POINTS 3\nVARS theta_i,phi_i,theta_s,phi_s,BTDF\n"
        "0.0,0.0,0.0,180.0,0.26\n0.0,0.0,10.0,180.0,0.25\n0.0,0.0,20.0,0.0,0.24\n"
    )
    (table,) = read_scatter_astm(path, 2.05, error=0.1, side="btdf")
    np.testing.assert_allclose(table.wavelength_nm, 632.8)
    np.testing.assert_allclose(table.phi_deg, [0.0, 0.0, 180.0])
    theta, value, _ = table.section(632.8, 0.0)
    np.testing.assert_allclose(theta, [0.0, 10.0, 20.0])
    np.testing.assert_allclose(value, [0.26, 0.25, 0.24])
    path.write_text("SOURCE laser\n1 2 3\n")
    with pytest.raises(MeasurementError, match="VARS"):
        read_scatter_astm(path, 2.05, error=0.1, side="btdf")


BSDF = """<?xml version="1.0"?>
<WindowElement xmlns="http://windows.lbl.gov"><Optical><Layer>
<DataDefinition><AngleBasis><AngleBasisName>two rings</AngleBasisName>
<AngleBasisBlock><Theta>0</Theta><nPhis>1</nPhis></AngleBasisBlock>
<AngleBasisBlock><Theta>40</Theta><nPhis>2</nPhis></AngleBasisBlock></AngleBasis></DataDefinition>
<WavelengthData><Wavelength unit="Integral">Visible</Wavelength><WavelengthDataBlock>
<WavelengthDataDirection>Transmission Front</WavelengthDataDirection>
<ColumnAngleBasis>two rings</ColumnAngleBasis><RowAngleBasis>two rings</RowAngleBasis>
<ScatteringData>0.26, 0.2, 0.2, 0.2, 0.3, 0.1, 0.2, 0.1, 0.3</ScatteringData>
</WavelengthDataBlock></WavelengthData></Layer></Optical></WindowElement>"""


def test_bsdf_xml_file(tmp_path: Path) -> None:
    path = tmp_path / "sample.xml"
    path.write_text(BSDF)
    (table,) = read_bsdf_xml(path, 2.05, error=0.1)
    assert table.side == "btdf"
    theta, value, _ = table.section(float("nan"), 0.0)
    np.testing.assert_allclose(theta, [0.0, 40.0, 40.0])
    np.testing.assert_allclose(value, [0.26, 0.2, 0.2])
    # The undeviated beam lies on the diagonal: azimuth 0
    straight = (table.incidence_deg == 40.0) & (table.value == 0.3)
    np.testing.assert_allclose(table.phi_deg[straight], 0.0)
    for broken, message in (
        (BSDF.replace("0.26, ", ""), "8 values"),
        (BSDF.replace("0.26", "-1"), "negative"),
        (BSDF.replace("</Layer>", ""), "well-formed"),
        ('<!DOCTYPE x [<!ENTITY a "b">]>' + BSDF, "entities"),
    ):
        path.write_text(broken)
        with pytest.raises(MeasurementError, match=message):
            read_bsdf_xml(path, 2.05, error=0.1)


def test_a_table_in_place_of_the_measurement_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "pane.xml"
    for text, said in ((klems(np.zeros((3, 3))), "a BSDF in XML"), ("<a/>", "a file in XML")):
        for begin in ("", "\ufeff", "\n "):
            path.write_text(begin + text, encoding="utf-8")
            with pytest.raises(MeasurementError, match=rf"pane.xml: is {said}.*measurement file"):
                load_measurement(path)
    (tmp_path / "flux.csv").write_text("wavelength_nm,incidence_deg,R,T\n550,0,0.1,0.8\n")
    with pytest.raises(MeasurementError, match=r"flux.csv: is a table of measured values"):
        load_measurement(tmp_path / "flux.csv")
    (tmp_path / "opal.dat").write_text("WAVELENGTH 550\nVARS theta,bsdf\n0,1\n")
    with pytest.raises(MeasurementError, match=r"opal.dat: is a table of scattering \(ASTM"):
        load_measurement(tmp_path / "opal.dat")


def klems(value: np.ndarray, *, side: str = "Reflection Front", name: str = "Visible",
          structure: str = "Columns") -> str:  # fmt: skip
    """Two rings: the normal, and 40 degrees at azimuths 0 and 180."""
    text = BSDF.replace("Transmission Front", side).replace("Visible", name)
    text = text.replace(
        "<DataDefinition>",
        f"<DataDefinition><IncidentDataStructure>{structure}</IncidentDataStructure>",
    )
    cells = ", ".join(f"{cell:g}" for cell in value.ravel())
    start, end = text.index("<ScatteringData>") + 16, text.index("</ScatteringData>")
    return text[:start] + cells + text[end:]


@pytest.mark.parametrize("side", ["Transmission Front", "Reflection Front"])
def test_a_clear_pane_holds_no_scattering(tmp_path: Path, side: str) -> None:
    path = tmp_path / "clear.xml"
    for value in (np.diag([34.3, 36.5, 36.5]), np.zeros((3, 3))):
        path.write_text(klems(value, side=side))
        with pytest.warns(UserWarning, match="undeviated or mirrored beam alone"):
            assert read_bsdf_xml(path, 3.0, error=0.1) == []
    # The mirrored beam may be numbered by its azimuth, too
    path.write_text(klems(np.array([[9, 0, 0], [0, 0, 9], [0, 9, 0.0]])))
    with pytest.warns(UserWarning, match="undeviated or mirrored beam alone"):
        assert read_bsdf_xml(path, 3.0, error=0.1) == []


def test_rows_of_incidence_are_columns_of_the_other_kind(tmp_path: Path) -> None:
    value = np.array([[0.26, 0.2, 0.2], [0.1, 0.3, 0.05], [0.15, 0.1, 0.3]])
    tables = []
    for structure, cells in (("Columns", value), ("Rows", value.T)):
        path = tmp_path / "sample.xml"
        path.write_text(klems(cells, side="Transmission Front", structure=structure))
        tables += read_bsdf_xml(path, 2.0, error=0.1)
    one, other = (
        sorted(zip(t.incidence_deg, t.theta_deg, t.phi_deg, t.value, strict=True)) for t in tables
    )
    assert one == other
    path.write_text(klems(value, structure="TensorTree3"))
    with pytest.raises(MeasurementError, match="structure 'tensortree3'"):
        read_bsdf_xml(path, 2.0, error=0.1)


def test_ranges_other_than_the_visible_are_named(tmp_path: Path) -> None:
    value = np.full((3, 3), 0.2)
    path = tmp_path / "sample.xml"
    both = klems(value).replace("</Layer>", klems(2 * value, name="Solar").partition(
        "</DataDefinition>")[2].partition("</Layer>")[0] + "</Layer>")  # fmt: skip
    path.write_text(both)
    with pytest.warns(UserWarning, match="Solar are left out"):
        (table,) = read_bsdf_xml(path, 2.0, error=0.1)
    np.testing.assert_array_equal(table.value, 0.2)
    path.write_text(klems(value, name="Solar"))
    with pytest.warns(UserWarning, match="'Solar' stand for it"):
        read_bsdf_xml(path, 2.0, error=0.1)


def test_a_brdf_over_the_visible_tilts_faces(tmp_path: Path) -> None:
    """Tables averaged over the visible are compared with the fit of averages."""
    from types import SimpleNamespace

    from tracer.scattering.fits.surface import surface_tilt
    from tracer.scattering.plates.medium import ScatteringMedium

    path = tmp_path / "sample.xml"
    path.write_text(klems(np.full((3, 3), 0.5)))
    tables = read_bsdf_xml(path, 2.0, error=0.1)
    medium = ScatteringMedium(
        index=1.5, mean_free_path_mm=5.0, absorption_per_mm=0.01, g=0.5, gamma=5.0
    )
    fit = SimpleNamespace(average=SimpleNamespace(medium=medium), common=())
    measurement = SimpleNamespace(scatter=tables, index=1.5)
    assert np.isfinite(surface_tilt(measurement, fit).rms_slope)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</Optical>", "<Layer></Layer></Optical>", "describes 2 layers"),
        ("<ColumnAngle", "<ScatteringDataType>flux</ScatteringDataType><ColumnAngle", "'flux'"),
        ('"Integral">Visible', '"angstrom">5500', "Wavelength in 'angstrom'"),
        ("<Layer>", '<Layer><Thickness unit="furlong">1</Thickness>', "Thickness in 'furlong'"),
    ],
)  # fmt: skip
def test_what_a_bsdf_file_means_otherwise_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "sample.xml"
    path.write_text(BSDF.replace(old, new))
    with pytest.raises(MeasurementError, match=message):
        read_bsdf_xml(path, 2.05, error=0.1)


def test_a_bsdf_file_of_another_plate_is_warned_about(tmp_path: Path) -> None:
    path = tmp_path / "sample.xml"
    path.write_text(BSDF.replace("<Layer>", '<Layer><Thickness unit="Meter">0.003</Thickness>'))
    with pytest.warns(UserWarning, match=r"of a plate of 3 mm, and is taken for one of 2\.05 mm"):
        read_bsdf_xml(path, 2.05, error=0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_bsdf_xml(path, 3.0, error=0.1)


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ("wavelength_nm,incidence_deg,R,T,R_err", "'R_err' is not read; did you mean 'R_error'"),
        ("wavelength_nm,incidence_deg,R,R,T", "two columns are called 'R'"),
        ("wavelength_nm,incidence_deg,R,T,remark", "'remark' is not read; there may be"),
    ],
)
def test_columns_that_nobody_reads_are_refused(tmp_path: Path, head: str, message: str) -> None:
    path = write(tmp_path, [(*row, 0.1) for row in GOOD])
    table = tmp_path / "plate.csv"
    table.write_text("\n".join([head, *table.read_text().splitlines()[1:]]) + "\n")
    with pytest.raises(MeasurementError, match=re.escape(message)):
        load_measurement(path)


def test_units_and_sides_hold_for_scattering_tables_too(tmp_path: Path) -> None:
    scatter = 'thickness = 2.05\nscatter = [{ file = "s.csv" SIDE }]'
    rows: list[tuple[object, ...]] = [(w / 1000, a, r, t) for w, a, r, t in GOOD]
    head = '[units]\nwavelength = "um"'
    text = "wavelength_nm,incidence_deg,theta_deg,btdf\n0.55,0,10,0.2\n0.55,0,20,0.1\n"
    (tmp_path / "s.csv").write_text(text)
    path = write(tmp_path, rows, head=head, plate=scatter.replace("SIDE", ""))
    material, _ = load_measurement(path)
    np.testing.assert_allclose(material.scatter[0].wavelength_nm, 550.0)
    path = write(tmp_path, rows, head=head, plate=scatter.replace("SIDE", ', side = "brdf"'))
    with pytest.raises(MeasurementError, match="holds no brdf, but btdf"):
        load_measurement(path)


@pytest.mark.parametrize(
    ("said", "nm"), [("633nm", 633.0), ("0.633 um", 633.0), ("633", 633.0), ("0.633", 633.0)]
)
def test_wavelengths_of_astm_files(tmp_path: Path, said: str, nm: float) -> None:
    path = tmp_path / "a.astm"
    rows = "VARS theta_i,theta_s,BTDF\n0,10,0.2\n0,20,0.1\n"
    path.write_text(f"WAVELENGTH {said}\n{rows}")
    (table,) = read_scatter_astm(path, 2.05, error=0.1, side="btdf")
    np.testing.assert_allclose(table.wavelength_nm, nm)
    path.write_text(f"WAVELENGTH red\n{rows}")
    with pytest.raises(MeasurementError, match="'red' is no wavelength"):
        read_scatter_astm(path, 2.05, error=0.1, side="btdf")
    path.write_text(
        rows.replace("BTDF", "BTDF,sigma").replace("0.2", "0.2,9").replace("0.1", "0.1,9")
    )
    with pytest.raises(
        MeasurementError, match=r"several columns beside the angles \(btdf, sigma\)"
    ):
        read_scatter_astm(path, 2.05, error=0.1, side="btdf")
