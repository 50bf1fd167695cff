"""Laws in a map: read back as they were written, refused where they are not sound."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
from raymap.laws.lambertian import LambertianLaw
from raymap.laws.medium import MediumLaw, transmitted
from raymap.laws.mirror import MirrorLaw
from raymap.laws.phase import PhaseLaw
from raymap.laws.radial import RadialScatter
from raymap.laws.sheet import FilterLaw
from raymap.laws.smooth import FresnelLaw
from raymap.laws.stack import StackLaw, StoredLayer
from raymap.laws.stored import FORMS, laws_of, stored_laws
from raymap.laws.table import TableLaw
from raymap.laws.tabulated import MeasuredBsdf, TabulatedLaw
from raymap.model.directory import ChannelSet, Directory, Medium, Source, Surface
from raymap.model.errors import FormatError, SceneError

NM = (450.0, 550.0)
GOLDEN = Path(__file__).parents[2] / "data" / "golden" / "v1"


def directory(n_surfaces: int, n_media: int = 2) -> Directory:
    return Directory(
        sources=(Source(name="lamp"),),
        surfaces=tuple(Surface(name=f"s{k}") for k in range(n_surfaces)),
        media=tuple(Medium(name=f"m{k}") for k in range(n_media)),
    )


def channels(laws: dict[str, Any] | None = None) -> ChannelSet:
    index = ((1.0, 1.0), (1.52, 1.52))
    return ChannelSet(kind="spectral", wavelengths_nm=NM, refractive_index=index, laws=laws or {})


LAWS = (
    FresnelLaw(),
    LambertianLaw(reflectance=(0.8, 0.6), transmittance=(0.1, 0.2)),
    MirrorLaw(n=(0.06, 0.06), k=(3.0, 3.6), roughness=0.2),
    StackLaw(
        between=(0, 1),
        layers=(StoredLayer(thickness_nm=550.0 / 4.0 / 1.38, n=(1.38, 1.38)),),
    ),
    TableLaw(angle_deg=(0.0, 90.0), reflectance=((0.1, 0.9), (0.2, 1.0)),
             transmittance=((0.9, 0.1), (0.7, 0.0))),
    None,
)  # fmt: skip


def test_laws_are_read_back_from_the_file(tmp_path: Path) -> None:
    media = (MediumLaw(), MediumLaw(scattering=(0.1, 0.2), phase=PhaseLaw(kind="rayleigh")))
    stated = channels(stored_laws(LAWS, media))
    path = tmp_path / "laws.raymap"
    with raymap.RayMapWriter.create(path, directory(len(LAWS))) as writer:
        writer.add_channel_set(stated)
    with raymap.open(path) as ray_map:
        found = ray_map.laws()
        assert found is not None
        assert found.surfaces == LAWS
        assert found.media == media


def test_maps_without_laws_have_none() -> None:
    with raymap.open(GOLDEN / "lens.raymap") as ray_map:
        assert ray_map.laws() is None


def test_a_map_without_laws_is_continued_in_its_own_channels(tmp_path: Path) -> None:
    path = tmp_path / "old.raymap"
    with raymap.RayMapWriter.create(path, directory(1)) as writer:
        writer.add_channel_set(channels())
    with raymap.RayMapWriter.append_to(path) as writer:
        assert writer.add_channel_set(channels(stored_laws([FresnelLaw()], [None, None]))) == 0
        other = channels().model_copy(update={"wavelengths_nm": (500.0, 600.0)})
        assert writer.add_channel_set(other) == 1


def test_a_quarter_wave_of_the_right_index() -> None:
    """R = ((n0 ns - n1²) / (n0 ns + n1²))² at normal incidence (Macleod, ch. 3)."""
    law, bare = LAWS[3], FresnelLaw()
    assert law is not None
    n_i, n_o = np.array([1.0, 1.0]), np.array([1.52, 1.52])
    r, t = law.shares(channels(), n_i, n_o, np.array([1.0]))
    expected = ((1.52 - 1.38**2) / (1.52 + 1.38**2)) ** 2
    assert r[1, 0] == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(r + t, 1.0, atol=1e-9)
    # From the other side the same, at the angle that Snell's law joins
    inside = math.sqrt(1.0 - (math.sin(0.5) / 1.52) ** 2)
    there, _ = law.shares(channels(), n_i, n_o, np.array([math.cos(0.5)]))
    back, _ = law.shares(channels(), n_o, n_i, np.array([inside]))
    np.testing.assert_allclose(there, back, atol=1e-5)
    assert bare.shares(channels(), n_i, n_o, np.array([1.0]))[0][0, 0] == pytest.approx(
        (0.52 / 2.52) ** 2
    )


def test_shares_by_hand() -> None:
    one, cosine = np.ones(2), np.cos(np.radians([0.0, 45.0]))
    table = LAWS[4]
    assert table is not None
    r, t = table.shares(channels(), one, one, cosine)
    np.testing.assert_allclose(r, [[0.1, 0.5], [0.2, 0.6]], atol=1e-4)
    np.testing.assert_allclose(t, [[0.9, 0.5], [0.7, 0.35]], atol=1e-4)
    # Born & Wolf 14.2: ((n - 1)² + k²) / ((n + 1)² + k²)
    metal = LAWS[2]
    assert metal is not None
    r, t = metal.shares(channels(), one, one, np.array([1.0]))
    assert r[1, 0] == pytest.approx((0.94**2 + 3.6**2) / (1.06**2 + 3.6**2))
    assert not t.any()
    # The way inside the sheet is longer by 1 / cos of the angle there
    _, t = FilterLaw(transmittance=(0.5, 0.9), index=1.5).shares(channels(), one, one, cosine)
    way = 1.0 / math.sqrt(1.0 - 0.5 / 1.5**2)
    np.testing.assert_allclose(t, [[0.5, 0.5**way], [0.9, 0.9**way]])


def test_media_by_hand() -> None:
    np.testing.assert_allclose(
        transmitted([0.0, 2.0, np.inf], [5.0, 0.5, 0.1]), [1.0, 1 / math.e, 0.0]
    )
    assert transmitted(np.inf, 0.0) == 1.0
    mu = np.array([-1.0, 0.0, 1.0])
    rayleigh = PhaseLaw(kind="rayleigh").density(mu)
    np.testing.assert_allclose(rayleigh, 3.0 * (1.0 + mu**2) / (16.0 * math.pi))
    peaked = PhaseLaw(kind="henyey_greenstein", g=0.5).density(1.0)
    assert peaked == pytest.approx(0.75 / (4.0 * math.pi * 0.5**3))


@pytest.mark.parametrize(
    ("laws", "words"),
    [
        ({"surfaces": []}, "not those of its 1 surfaces"),
        ({"surfaces": [{"law": "fresnel"}], "media": [None]}, "not those of its 2 media"),
        ({"surfaces": 7, "media": [None, None]}, "not those of its 1 surfaces"),
        (
            {"surfaces": [{"law": "lambertian", "reflectance": [0.1]}], "media": [None, None]},
            "other channels than the 2",
        ),
        (
            {"surfaces": [{"law": "lambertian", "reflectance": [0.1, 1.5]}], "media": [None] * 2},
            "law of surface 's0' is not sound: reflectance.1",
        ),
        (
            {"surfaces": [{"law": "stack", "between": [0, 7], "layers": []}], "media": [None] * 2},
            "media that the map does not have",
        ),
        (
            {
                "surfaces": [
                    {"law": "table", "angle_deg": [0], "reflectance": [[0.7]] * 2,
                     "transmittance": [[0.7]] * 2}
                ],
                "media": [None] * 2,
            },
            "exceeds 1",
        ),
    ],
)  # fmt: skip
def test_laws_that_are_not_sound_are_refused(laws: dict[str, Any], words: str) -> None:
    with pytest.raises(FormatError, match=words):
        laws_of(directory(1), channels(laws))


@pytest.mark.parametrize(
    "law",
    [
        {"law": "lambertian", "reflectance": []},
        {"law": "filter", "transmittance": []},
        {"law": "table", "angle_deg": [0], "reflectance": [], "transmittance": []},
        {"law": "stack", "between": [0, 1], "layers": [{"thickness_nm": 1, "n": []}]},
    ],
)
def test_laws_without_channels_are_refused(law: dict[str, Any]) -> None:
    with pytest.raises(FormatError, match="other channels than the 2"):
        laws_of(directory(1), channels({"surfaces": [law], "media": [None, None]}))


SIDE = {"theta_i_deg": [0.0], "theta_o_deg": [0.0, 80.0], "phi_deg": [0.0, 180.0]}


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (MirrorLaw(n=(0.0, 0.0), k=(0.0, 0.0)), "no shares of light"),
        (StackLaw(between=(0, 1), layers=(StoredLayer(thickness_nm=1e308, n=(1.4, 1.4)),)),
         "nothing can be computed"),
        (TabulatedLaw(reflected=MeasuredBsdf(**SIDE, values=(((0.1, 0.1), (0.1,)),))),
         "rows of different lengths"),
        (TabulatedLaw(reflected=MeasuredBsdf(**SIDE, values=(((1e308, 1e308),) * 2,))),
         "creates energy"),
        (TabulatedLaw(reflected=MeasuredBsdf(**{**SIDE, "phi_deg": []}, values=(((), ()),))),
         "azimuths"),
    ],
)  # fmt: skip
def test_numbers_that_say_no_shares(law: Any, words: str) -> None:
    with pytest.raises(raymap.RayMapError, match=words):
        law.shares(channels(), np.ones(2), np.ones(2), np.array([0.0, 0.5, 1.0]))


def test_layers_between_media_without_an_index() -> None:
    stated = channels().model_copy(update={"refractive_index": ((0.0, 1.0), (-1.0, 1.0))})
    with pytest.raises(SceneError, match="without an index"):
        StackLaw(between=(0, 1), layers=()).shares(stated, np.ones(2), np.ones(2), np.ones(1))


@pytest.mark.parametrize(
    ("n_i", "n_o", "cosine"),
    [([1.0], [1.0, 1.0], [1.0]), ([0.0, 1.0], [1.0, 1.0], [1.0]), ([1.0, 1.0], [1.0, 1.0], [1.1])],
)
def test_shares_of_what_is_no_incidence(n_i: list[float], n_o: list[float], cosine: Any) -> None:
    with pytest.raises(ValueError, match=r"indices|cosines"):
        FresnelLaw().shares(channels(), np.array(n_i), np.array(n_o), np.array(cosine))


@pytest.mark.parametrize(
    "scatter",
    [
        RadialScatter(abg=(0.01, 0.01, 1e5), reference_nm=1e-9),
        RadialScatter(harvey_shack=(1e308, 1e-300, -0.1), reference_nm=633.0),
        RadialScatter(abg=(1e308, 1e-300, 2.0)),
    ],
)
def test_scatter_that_no_number_holds(scatter: RadialScatter) -> None:
    with pytest.raises(SceneError):
        scatter.tables(NM)


@pytest.mark.parametrize(
    "phase",
    [
        PhaseLaw(kind="henyey_greenstein", g=1.0),
        PhaseLaw(kind="generalized", g=-1.0),
        PhaseLaw(kind="tabulated", angle_deg=(0.0, 1e-9, 180.0), value=(1.0, 1.0, 1.0)),
        PhaseLaw(kind="tabulated", angle_deg=(0.0, 180.0), value=(0.0, 0.0)),
    ],
)
def test_phase_functions_without_a_density(phase: PhaseLaw) -> None:
    with pytest.raises(SceneError):
        phase.density([-1.0, 0.0, 1.0])


def test_a_phase_function_of_the_largest_numbers() -> None:
    """Only ratios count: as of ones."""
    one = PhaseLaw(kind="tabulated", angle_deg=(0.0, 180.0), value=(1e308, 1e308))
    np.testing.assert_allclose(one.density([-1.0, 0.3]), 1.0 / (4.0 * math.pi))


def test_laws_of_a_later_version_are_none() -> None:
    later = {"law": "hologram", "lines": 1200}
    found = laws_of(directory(1), channels({"surfaces": [later], "media": [None, None]}))
    assert found is not None
    assert found.surfaces == (None,)


def test_the_format_page_lists_every_form() -> None:
    page = (Path(__file__).parents[3] / "docs" / "format.md").read_text()
    for name, form in FORMS.items():
        row = next(line for line in page.splitlines() if line.startswith(f"| `{name}` |"))
        for key in form.model_fields:
            assert key == "law" or f"`{key}`" in row or (key == "scatter" and name == "rough")
