"""Ray files: round trips, headers that others wrote, headers that lie."""

from __future__ import annotations

import contextlib
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from raymap import rayfiles
from raymap.model.errors import MapExists
from raymap.rayfiles import RayFileError, RaySet, Spectrum
from tests.examples import examples


def some_rays(n: int = 50, seed: int = 1, **more: object) -> RaySet:
    random = np.random.default_rng(seed)
    direction = random.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return RaySet(
        position=random.normal(size=(n, 3)).astype(np.float32),
        direction=direction.astype(np.float32),
        flux=random.uniform(0.5, 2, n).astype(np.float32),
        **more,  # type: ignore[arg-type]
    )


def same(a: RaySet, b: RaySet, *, wavelength: float = 0.0) -> None:
    assert np.array_equal(a.position, b.position)
    assert np.array_equal(a.direction, b.direction)
    assert np.array_equal(a.flux, b.flux)
    assert (a.length_unit, a.flux_unit) == (b.length_unit, b.flux_unit)
    assert (a.wavelength_nm is None) == (b.wavelength_nm is None)
    if a.wavelength_nm is not None and b.wavelength_nm is not None:
        np.testing.assert_allclose(a.wavelength_nm, b.wavelength_nm, rtol=wavelength)


@pytest.mark.parametrize("suffix", [".tm25ray", ".dat", ".sdf"])
@pytest.mark.parametrize("colored", [False, True])
def test_what_is_written_is_read(tmp_path: Path, suffix: str, colored: bool) -> None:
    nm = np.linspace(400, 700, 50, dtype=np.float32) if colored else None
    rays = some_rays(wavelength_nm=nm, title="lamp")
    path = rayfiles.write(rays, tmp_path / f"rays{suffix}")
    again = rayfiles.read(path)
    # Zemax files state micrometres
    same(rays, again, wavelength=0.0 if suffix == ".tm25ray" else 2e-7)
    assert again.title == "lamp"


def test_lumen_with_colors(tmp_path: Path) -> None:
    xyz = np.random.default_rng(2).uniform(0, 1, (50, 3)).astype(np.float32)
    rays = some_rays(flux_unit="lm")
    rays = RaySet(**{**vars(rays), "tristimulus": np.insert(xyz[:, ::2], 1, rays.flux, axis=1)})
    again = rayfiles.read(rayfiles.write(rays, tmp_path / "rays.tm25ray"))
    same(rays, again)
    assert np.array_equal(again.tristimulus, rays.tristimulus)


@pytest.mark.parametrize("n_spectra", [1, 3])
def test_spectra(tmp_path: Path, n_spectra: int) -> None:
    spectra = tuple(
        Spectrum(
            wavelength_nm=np.arange(400, 410 + k, dtype=np.float32),
            power=np.arange(10 + k, dtype=np.float32),
        )
        for k in range(n_spectra)
    )
    index = None if n_spectra == 1 else (np.arange(50) % n_spectra).astype(np.int32)
    rays = some_rays(spectra=spectra, spectrum=index)
    again = rayfiles.read(rayfiles.write(rays, tmp_path / "rays.tm25ray"))
    assert len(again.spectra) == n_spectra
    for a, b in zip(spectra, again.spectra, strict=True):
        assert np.array_equal(a.power, b.power)
    if index is None:
        assert again.spectrum is None
    else:
        assert np.array_equal(again.spectrum, index)


def test_pieces_are_one_file(tmp_path: Path) -> None:
    rays = some_rays(90)
    whole = rayfiles.write(rays, tmp_path / "whole.sdf")
    with rayfiles.create(tmp_path / "pieces.sdf", rays) as writer:
        for first in range(0, 90, 30):
            part = slice(first, first + 30)
            writer.append(
                RaySet(
                    position=rays.position[part],
                    direction=rays.direction[part],
                    flux=rays.flux[part],
                )
            )
    same(rayfiles.read(whole), rayfiles.read(tmp_path / "pieces.sdf"))


def test_units_of_length(tmp_path: Path) -> None:
    rays = some_rays(length_unit="in")
    in_inches = rayfiles.read(rayfiles.write(rays, tmp_path / "rays.sdf"))
    assert in_inches.length_unit == "in"
    in_mm = rayfiles.read(rayfiles.write(rays, tmp_path / "rays.tm25ray"))
    assert in_mm.length_unit == "mm"
    np.testing.assert_allclose(in_mm.position, 25.4 * rays.position, rtol=1e-6)


@given(n=st.integers(1, 40), seed=st.integers(0, 1000), colored=st.booleans())
@settings(max_examples=examples(20))
def test_any_rays_come_back(tmp_path_factory: object, n: int, seed: int, colored: bool) -> None:
    folder = tmp_path_factory.mktemp("rays")  # type: ignore[attr-defined]
    nm = np.full(n, 555, np.float32) if colored else None
    rays = some_rays(n, seed, wavelength_nm=nm)
    for suffix in rayfiles.RAY_FORMATS:
        path = rayfiles.write(rays, folder / f"r{suffix}")
        same(rays, rayfiles.read(path), wavelength=1e-6)


# -- headers as others write them ---------------------------------------------------------------


def osram_like(rays: int) -> bytes:
    """The header of a maker's file as the crate tm25ray documents it (docs/format.md there):
    creation method -1, 0.051 W, one table of 51 rows, a date with a blank, no additional columns.
    """
    head = struct.pack("<4siiff", b"TM25", 2013, -1, 0.0, 0.051)
    head += struct.pack("<Q28s", rays, b"2026-05-12 13:57:44")
    head += struct.pack("<iifff", 0, 3, float("nan"), 220.0, 320.0)
    head += struct.pack("<iii", 1, 0, 0) + bytes(168)
    head += struct.pack("<8i", 1, 1, 1, 0, 0, 0, 0, 0)
    texts = ["SU CULCP1.VC", "ams-OSRAM AG", "BZ", "ams-OSRAM AG", "n/a", "n/a", "150mA", "-", "-"]
    head += b"".join(text.encode("utf-32-le").ljust(4000, b"\0") for text in texts)
    head += struct.pack("<i", 51)
    head += b"".join(struct.pack("<ff", 220 + 2 * k, 100 - k) for k in range(51))
    return head + bytes(4)


def test_a_makers_tm25_file(tmp_path: Path) -> None:
    head = osram_like(1000)
    # The file of 100,000 rays documented there has 2,836,704 bytes
    assert len(head) + 100_000 * 28 == 2_836_704
    ray = struct.pack("<7f", 0.39076, 0.12505, -0.755, -0.51988, 0.14747, 0.84141, 5.1e-5)
    path = tmp_path / "rayfile.TM25RAY"
    path.write_bytes(head + 1000 * ray)
    rays = rayfiles.read(path)
    assert len(rays) == 1000
    assert rays.total_flux == pytest.approx(0.051)
    assert rays.title == "SU CULCP1.VC"
    assert rays.description["operation"] == "150mA"
    assert rays.spectra[0].wavelength_nm[-1] == 320
    np.testing.assert_allclose(np.linalg.norm(rays.direction, axis=1), 1, atol=2e-7)


def test_a_tm25_file_of_ours_by_offsets(tmp_path: Path) -> None:
    """The offsets of the standard, read without our reader."""
    rays = some_rays(
        30, wavelength_nm=np.linspace(450, 650, 30, dtype=np.float32), title="Lampe Ω",
        description={"manufacturer": "us"},
    )  # fmt: skip
    raw = rayfiles.write(rays, tmp_path / "rays.tm25ray").read_bytes()
    assert raw[:8] == b"TM25" + (2013).to_bytes(4, "little")
    lumen, watt = struct.unpack_from("<ff", raw, 12)
    assert np.isnan(lumen)
    assert watt == pytest.approx(rays.total_flux)
    assert struct.unpack_from("<Q", raw, 20) == (30,)
    assert struct.unpack_from("<ii", raw, 56) == (0, 2)
    assert struct.unpack_from("<ff", raw, 68) == (450, 650)
    assert struct.unpack_from("<8i", raw, 256) == (1, 1, 1, 1, 0, 0, 0, 0)
    assert raw[288 : 288 + 4000].decode("utf-32-le").rstrip("\0") == "Lampe Ω"
    assert raw[4288 : 4288 + 4000].decode("utf-32-le").rstrip("\0") == "us"
    table = np.frombuffer(raw, "<f4", offset=36288).reshape(30, 8)
    assert np.array_equal(table[:, 3:6], rays.direction)
    assert np.array_equal(table[:, 7], rays.wavelength_nm)


def vtt_header(rays: int, unit: int = 0, kind: int = 2, identifier: int = 8675309) -> bytes:
    """As VTT's MMP ray tracer writes it (ZemaxRayfileDetector.cpp): metres, spectral."""
    head = struct.pack("<iI100sff", identifier, rays, b"Zemax Ray file created by MMP", 3.0, 3.0)
    head += struct.pack("<f4f", 0.0, 0.0, 180.0, 0.0, 360.0)
    head += struct.pack("<I6f3f4f", unit, *(0.0,) * 6, *(1.0,) * 3, *(0.0,) * 4)
    return head + struct.pack("<4i", kind, 0, 28, 0)


def test_another_programs_zemax_file(tmp_path: Path) -> None:
    path = tmp_path / "rays.dat"
    ray = struct.pack("<8f", 0.001, 0.002, 0.003, 0.0, 0.6, 0.8, 1.0, 0.55)
    path.write_bytes(vtt_header(3) + 3 * ray)
    rays = rayfiles.read(path)
    assert (rays.length_unit, rays.flux_unit, len(rays)) == ("m", "W", 3)
    np.testing.assert_allclose(rays.wavelength_nm, 550, rtol=1e-6)
    np.testing.assert_allclose(rays.in_unit("mm").position[0], [1, 2, 3], rtol=1e-6)


def test_a_zemax_file_of_ours_by_offsets(tmp_path: Path) -> None:
    rays = some_rays(20, flux_unit="lm", length_unit="cm")
    for version, identifier in ((1, 8675309), (2, 1010)):
        path = tmp_path / f"rays{version}.dat"
        raw = rayfiles.write(rays, path, zemax_version=version).read_bytes()  # type: ignore[arg-type]
        assert struct.unpack_from("<iI", raw, 0) == (identifier, 20)
        assert struct.unpack_from("<f", raw, 108)[0] == pytest.approx(rays.total_flux)
        assert struct.unpack_from("<I", raw, 136) == (2,)
        assert struct.unpack_from("<ii", raw, 192) == (0, 1)
        assert len(raw) == 208 + 20 * 28


def test_the_text_form(tmp_path: Path) -> None:
    path = tmp_path / "rays.dat"
    path.write_text("2 4\n0 0 1 0 0 1 0.5\n1 2 3 0.6 0 0.8 0.25\n")
    rays = rayfiles.read(path)
    assert (len(rays), rays.total_flux, rays.length_unit) == (2, 0.75, "mm")
    assert rays.wavelength_nm is None


# -- headers that lie ---------------------------------------------------------------------------


def patched(raw: bytes, offset: int, form: str, *values: float) -> bytes:
    data = bytearray(raw)
    struct.pack_into(form, data, offset, *values)
    return bytes(data)


FIRST_RAY = 36288
TM25_LIES = {
    "is not a TM-25 file": lambda raw: b"XM25" + raw[4:],
    "version 1999": lambda raw: patched(raw, 4, "<i", 1999),
    "promises no rays": lambda raw: patched(raw, 20, "<Q", 0),
    "promises 2000 rays": lambda raw: patched(raw, 20, "<Q", 2000),
    "promises 18446744073709551615 rays": lambda raw: patched(raw, 20, "<Q", 2**64 - 1),
    "promises 50 rays": lambda raw: raw[:-1],
    "too few for the header": lambda raw: raw[:300],
    "contradicts itself: flags": lambda raw: patched(raw, 256, "<i", 7),
    "neither radiant nor luminous": lambda raw: patched(raw, 264, "<i", 0),
    "no spectral table": lambda raw: patched(raw, 60, "<i", 3),
    "no column of wavelengths": lambda raw: patched(raw, 60, "<i", 2),
    "spectral table 1 has": lambda raw: patched(raw, 76, "<i", 1),
    "bytes of text": lambda raw: patched(raw, 84, "<i", -5),
    "ends within the header": lambda raw: patched(raw, 80, "<i", 1000),
    "not UTF-32": lambda raw: patched(raw, 288, "<I", 0x110000),
    "ray 1 of 50 has no position": lambda raw: patched(raw, FIRST_RAY, "<f", float("nan")),
    "ray 2 of 50 has no direction": lambda raw: patched(
        raw, FIRST_RAY + 28 + 12, "<f", float("inf")
    ),
    "a direction of length 5": lambda raw: patched(raw, FIRST_RAY + 12, "<3f", 3, 4, 0),
    "a negative flux": lambda raw: patched(raw, FIRST_RAY + 24, "<f", -1),
}


@pytest.mark.parametrize("what", TM25_LIES)
def test_tm25_headers_that_lie(tmp_path: Path, what: str) -> None:
    raw = rayfiles.write(some_rays(), tmp_path / "good.tm25ray").read_bytes()
    bad = tmp_path / "bad.tm25ray"
    bad.write_bytes(TM25_LIES[what](raw))
    with pytest.raises(RayFileError) as error:
        rayfiles.read(bad)
    assert what in str(error.value)
    assert "bad.tm25ray" in str(error.value)
    assert "\n" not in str(error.value)


ZEMAX_LIES = {
    "promises no rays": lambda raw: patched(raw, 4, "<I", 0),
    "promises 4000000000 rays": lambda raw: patched(raw, 4, "<I", 4_000_000_000),
    "promises 50 rays of 7 numbers": lambda raw: raw + b"\0",
    "promises 50 rays of 8 numbers": lambda raw: patched(raw, 192, "<i", 2),
    "too few for the header": lambda raw: raw[:100],
    "rays of kind 1": lambda raw: patched(raw, 192, "<i", 1),
    "unit of length 9": lambda raw: patched(raw, 136, "<I", 9),
    "unit of flux 5": lambda raw: patched(raw, 196, "<i", 5),
    "neither the binary header": lambda raw: patched(raw, 0, "<i", 1011),
    "ray 50 of 50 has no flux": lambda raw: raw[:-4] + struct.pack("<f", float("nan")),
    "a direction of length 0": lambda raw: patched(raw, 208 + 12, "<3f", 0, 0, 0),
}


@pytest.mark.parametrize("what", ZEMAX_LIES)
def test_zemax_headers_that_lie(tmp_path: Path, what: str) -> None:
    raw = rayfiles.write(some_rays(), tmp_path / "good.sdf").read_bytes()
    bad = tmp_path / "bad.sdf"
    bad.write_bytes(ZEMAX_LIES[what](raw))
    with pytest.raises(RayFileError) as error:
        rayfiles.read(bad)
    assert what in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    ["", "hello", "3 4\n0 0 1 0 0 1 0.5\n", "1 4\n0 0 1 0 0 1\n", "1 7\n0 0 1 0 0 1 1\n", "0 4\n"],
)
def test_texts_that_are_no_ray_files(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rays.dat"
    path.write_text(text)
    with pytest.raises(RayFileError):
        rayfiles.read(path)


@pytest.mark.parametrize(("name", "at"), [("b.tm25ray", 16), ("b.sdf", 112)])
def test_the_flux_is_that_of_the_header(tmp_path: Path, name: str, at: int) -> None:
    """LightTools writes powers relative to one another; the header alone states the flux."""
    rays = some_rays()
    raw = rayfiles.write(rays, tmp_path / f"a{name[1:]}").read_bytes()
    path = tmp_path / name
    path.write_bytes(patched(raw, at, "<f", 1.0))
    with pytest.warns(UserWarning, match="states 1 W, its rays carry .* the header counts"):
        found = rayfiles.read(path)
    assert found.total_flux == pytest.approx(1.0)
    np.testing.assert_allclose(found.flux * rays.total_flux, rays.flux, rtol=1e-6)
    with pytest.warns(UserWarning, match="the rays count"):
        assert rayfiles.read(path, flux_from="rays").total_flux == pytest.approx(rays.total_flux)
    # A header that states nothing, or what the rays carry to rounding, changes nothing
    for stated in (float("nan"), 0.0, -1.0, rays.total_flux * 1.001):
        path.write_bytes(patched(raw, at, "<f", stated))
        assert np.array_equal(rayfiles.read(path).flux, rays.flux)


def test_relative_powers_of_1000_rays(tmp_path: Path) -> None:
    rays = some_rays(1000, flux_unit="lm")
    rays = RaySet(**{**vars(rays), "flux": np.ones(1000, np.float32)})
    xyz = np.ones((1000, 3), np.float32)
    rays = RaySet(**{**vars(rays), "tristimulus": xyz})
    raw = rayfiles.write(rays, tmp_path / "a.tm25ray").read_bytes()
    path = tmp_path / "b.tm25ray"
    path.write_bytes(patched(raw, 12, "<f", 1.0))
    with pytest.warns(UserWarning, match="the header counts"):
        found = rayfiles.read(path)
    assert found.total_flux == pytest.approx(1.0)
    assert found.tristimulus is not None
    np.testing.assert_allclose(found.tristimulus, 1e-3, rtol=1e-6)


def test_luminous_flux_beside_radiant(tmp_path: Path) -> None:
    """Each column has its own total; one total alone tells the scale of both."""
    rays = some_rays()
    both = RaySet(**{**vars(rays), "luminous_flux": 300 * rays.flux})
    raw = rayfiles.write(both, tmp_path / "a.tm25ray").read_bytes()
    path = tmp_path / "b.tm25ray"
    for lumen, watt, wanted in (
        (1000.0, 5.0, (1000.0, 5.0)),
        (float("nan"), rays.total_flux / 10, (30 * rays.total_flux, rays.total_flux / 10)),
        (30 * rays.total_flux, float("nan"), (30 * rays.total_flux, rays.total_flux / 10)),
    ):
        path.write_bytes(patched(patched(raw, 12, "<f", lumen), 16, "<f", watt))
        with pytest.warns(UserWarning, match="the header counts"):
            found = rayfiles.read(path)
        assert found.luminous_flux is not None
        total = float(found.luminous_flux.sum(dtype=np.float64))
        assert (total, found.total_flux) == pytest.approx(wanted)


@pytest.mark.parametrize("first", ["3 4", "3.0 4.0", "3.000000E+00 4", "3.0, 4", " 3   4 extra"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("behind", ["", "\x1a", "\n\x1a\0\0"])
@pytest.mark.parametrize("encoding", ["ascii", "utf-8-sig", "utf-16"])
def test_texts_as_programs_write_them(
    tmp_path: Path, first: str, end: str, behind: str, encoding: str
) -> None:
    ray = "0.5 -1.25 2 0 0.6 0.8 1.5"
    lines = ["! made by hand", first, ray, "", ray.replace(" ", "\t"), ray + " ! the last"]
    path = tmp_path / "rays.dat"
    path.write_bytes((end.join(lines) + behind).encode(encoding))
    rays = rayfiles.read(path)
    assert (len(rays), rays.length_unit) == (3, "mm")
    np.testing.assert_array_equal(rays.position, np.tile(np.float32([0.5, -1.25, 2]), (3, 1)))
    assert rays.total_flux == pytest.approx(4.5)


@pytest.mark.parametrize("ray", ["0,5 -1,25 2,0 0 0,6 0,8 1,5", "0.5, -1.25, 2, 0, 0.6, 0.8, 1.5",
                                 "0.5,-1.25,2,0,0.6,0.8,1.5"])  # fmt: skip
def test_commas(tmp_path: Path, ray: str) -> None:
    path = tmp_path / "rays.dat"
    path.write_text(f"2 4\n{ray}\n{ray}\n")
    rays = rayfiles.read(path)
    np.testing.assert_array_equal(rays.position[1], np.float32([0.5, -1.25, 2]))
    assert rays.total_flux == pytest.approx(3.0)


def test_the_ray_that_is_no_ray_is_named(tmp_path: Path) -> None:
    path = tmp_path / "rays.dat"
    path.write_text("3 4\n0 0 1 0 0 1 1\n0 0 x 0 0 1 1\n0 0 1 0 0 1 1\n")
    with pytest.raises(RayFileError, match=r"rays\.dat: ray 2 is not"):
        rayfiles.read(path)
    for first in ("3.5 4", "-3 4", "nan 4", "3 4.5", "1e40 4", "inf 4"):
        path.write_text(f"{first}\n0 0 1 0 0 1 1\n")
        with pytest.raises(RayFileError, match="is not a Zemax source file"):
            rayfiles.read(path)


@given(place=st.integers(0, 36288 + 1399), value=st.integers(0, 255))
@settings(max_examples=examples(150))
def test_a_flipped_byte_never_crashes(tmp_path_factory: object, place: int, value: int) -> None:
    folder = tmp_path_factory.mktemp("flip")  # type: ignore[attr-defined]
    raw = bytearray(rayfiles.write(some_rays(), folder / "a.tm25ray").read_bytes())
    raw[place] = value
    (folder / "b.tm25ray").write_bytes(bytes(raw))
    with warnings.catch_warnings(action="ignore"), contextlib.suppress(RayFileError):
        assert len(rayfiles.read(folder / "b.tm25ray")) == 50


def test_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(RayFileError, match="ray files end in"):
        rayfiles.write(some_rays(), tmp_path / "rays.txt")
    path = rayfiles.write(some_rays(), tmp_path / "rays.sdf")
    before = path.read_bytes()
    with pytest.raises(MapExists):
        rayfiles.write(some_rays(3), path)
    assert path.read_bytes() == before
    nm = np.full(50, 500, np.float32)
    with pytest.raises(RayFileError, match="radiant flux only"):
        rayfiles.write(some_rays(flux_unit="lm", wavelength_nm=nm), tmp_path / "x.tm25ray")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["rays.sdf"]
    with pytest.raises(RayFileError, match="there is no ray file"):
        rayfiles.read(tmp_path / "none.sdf")


def test_wavelengths_in_a_wrong_unit_are_refused(tmp_path: Path) -> None:
    """Zemax text files have micrometres; 550 there is 0.55 mm."""
    path = tmp_path / "rays.dat"
    path.write_text("1 4\n0 0 0 0 0 1 0.5 550\n")
    with pytest.raises(RayFileError, match=r"a wavelength of 550000 nm, which is no light"):
        rayfiles.read(path)
