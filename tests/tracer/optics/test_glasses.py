"""Indices and absorption of materials: published values, and two independent packages."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from raymap.model.errors import MissingExtra, SceneError
from tracer.optics import dispersion as law
from tracer.optics.absorption import absorption_from_transmittance, extinction_index
from tracer.optics.glasses import find_glass, glass_names


def test_n_bk7_as_the_maker_prints_it() -> None:
    glass = find_glass("n-bk7")
    lines = [law.LINE_NM[line] for line in ("d", "F", "C")]
    np.testing.assert_allclose(
        glass.index(lines), [1.516800035, 1.522376290, 1.514322347], atol=5e-10
    )
    assert law.abbe_number(glass.dispersion) == pytest.approx(64.17, abs=0.005)
    # 6 mm at 400 nm
    assert np.exp(-6 * glass.absorption(400.0)) == pytest.approx(0.9980728, abs=2e-6)


@pytest.mark.parametrize(
    ("name", "n_d", "abbe"),
    [
        ("N-SK16", 1.62041, 60.32),
        ("F5", 1.60342, 38.03),
        ("SF11", 1.78472, 25.76),
        ("N-SSK2", 1.62229, 53.27),
        ("N-SK2", 1.60738, 56.65),
        ("S-BSL7", 1.51633, 64.14),
        ("fused silica", 1.45846, 67.82),
        ("PMMA", 1.4914, 57.4),
        ("PC", 1.585, 29.9),
        ("PS", 1.5905, 30.9),
        # The makers' catalogues for Zemax: topas.agf, 5013LS-01, and zeon.agf, E48R
        ("COC", 1.533202, 56.150461),
        ("COP", 1.531170, 56.0),
        ("water", 1.3334, 55.8),
        ("CaF2", 1.43384, 95.2),
        ("sapphire o", 1.76817, 72.2),
    ],
)
def test_published_index_and_abbe_number(name: str, n_d: float, abbe: float) -> None:
    glass = find_glass(name)
    assert glass.index(law.LINE_NM["d"]) == pytest.approx(n_d, abs=1.2e-3)
    assert law.abbe_number(glass.dispersion) == pytest.approx(abbe, rel=0.02)


def test_calcite_is_birefringent() -> None:
    assert find_glass("calcite o").index(589.3) == pytest.approx(1.658343, abs=2e-6)
    assert find_glass("calcite e").index(589.3) == pytest.approx(1.486130, abs=2e-6)


def test_every_shipped_row_gives_an_index_where_it_says() -> None:
    names = glass_names()
    assert len(names) > 100
    assert len(set(names)) == len(names)
    for name in names:
        glass = find_glass(name)
        low, high = glass.dispersion.range_nm
        values = glass.index(np.linspace(low, high, 50))
        # From lithium fluoride at 11 µm, 1.02 (Li), to germanium at 2.5 µm, 4.06 (Icenogle)
        assert np.all((values > 1.0) & (values < 4.2)), name
        assert np.all(glass.absorption(np.linspace(450, 650, 9)) >= 0)


def test_unknown_names_show_the_nearest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tracer.optics.glasses.util.find_spec", lambda _name: None)
    words = r"no glass 'N-BK77'; the nearest names are 'N-BK7', .* with the package opticalglass"
    with pytest.raises(SceneError, match=words):
        find_glass("N-BK77")
    with pytest.raises(SceneError, match="no glass 'lexan'; the nearest names are 'polycarbonate'"):
        find_glass("lexan")
    assert find_glass("pc").name == "polycarbonate"
    with pytest.raises(MissingExtra, match=r"'H-K9X' of CDGM.*pip install opticalglass"):
        find_glass("H-K9X", "CDGM")
    with pytest.raises(SceneError, match="no maker 'Zeiss'"):
        find_glass("N-BK7", "Zeiss")


def test_the_makers_lists_are_shipped() -> None:
    # nd and Abbe number as the makers' sheets print them
    for name, maker, n_d, abbe in (
        ("J-LAK14", "Hikari", 1.69680, 55.52),
        ("TAFD30", "Hoya", 1.88300, 40.8),
        ("K-SFLD6", "Sumita", 1.80518, 25.46),
        ("S-LAL10", "Ohara", 1.72000, 50.23),
        ("H-K9L", "CDGM", 1.51680, 64.20),
    ):
        glass = find_glass(name)
        assert glass.maker == maker
        assert glass.index(law.LINE_NM["d"]) == pytest.approx(n_d, abs=1e-5)
        assert law.abbe_number(glass.dispersion) == pytest.approx(abbe, abs=0.06)
        assert 0.9 < np.exp(-10.0 * glass.absorption(550.0)) <= 1.0


def test_makers_may_stand_with_the_name() -> None:
    for written in ("Schott N-BK7", "N-BK7 (Schott)", "schott: n-bk7"):
        assert find_glass(written).maker == "Schott"


def test_outside_the_range_is_a_warning() -> None:
    with pytest.warns(law.OutOfRangeWarning, match="'PMMA'.*300 nm.*extrapolated"):
        find_glass("PMMA").index([300.0, 550.0])
    with pytest.warns(law.OutOfRangeWarning, match="end value"):
        law.tabulated([400, 700], [1.5, 1.4]).index(800.0)
    with pytest.warns(law.OutOfRangeWarning, match="absorption asked for at 2600 nm"):
        find_glass("N-BK7").absorption(2600.0)


def test_laws() -> None:
    wavelengths = np.array([400.0, 500.0, 700.0])
    assert law.constant(1.5).index(wavelengths).tolist() == [1.5, 1.5, 1.5]
    assert not law.constant(1.5).dispersive
    cauchy = law.cauchy([1.5, 0.004, 1e-4])
    assert cauchy.index(500.0) == pytest.approx(1.5 + 0.004 / 0.25 + 1e-4 / 0.0625)
    assert cauchy.dispersive
    table = law.tabulated([700, 400], [1.4, 1.5])
    assert table.index(550.0) == pytest.approx(1.45)
    assert law.polynomial_index(500.0, [2.25, -0.01, 2.0]) == pytest.approx(
        np.sqrt(2.25 - 0.01 * 0.25)
    )
    assert law.abbe_number(law.constant(1.5)) == np.inf


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: law.constant(0.0), "must be positive"),
        (lambda: law.sellmeier([1.0], [0.1, 0.2]), "as many B as C"),
        (lambda: law.cauchy([]), "at least the coefficient A"),
        (lambda: law.tabulated([500], [1.5]), "two or more"),
        (lambda: law.tabulated([500, 500], [1.5, 1.5]), "stands twice"),
        (lambda: law.sellmeier([1.0], [0.3]).index(500.0), "no real refractive index at 500 nm"),
        (lambda: absorption_from_transmittance(500, [500, 500], [1, 1], 10), "stands twice"),
        (lambda: absorption_from_transmittance(500, [500, 600], [1, 1.1], 10), "between 0 and 1"),
        (lambda: absorption_from_transmittance(500, [500], [1, 1], 10), "as many values"),
        (lambda: absorption_from_transmittance(500, [500], [1], 0), "thickness must be positive"),
    ],
)
def test_bad_input_is_refused(build, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(SceneError, match=words):
        build()


def test_absorption_next_to_an_opaque_entry_is_infinite() -> None:
    values = absorption_from_transmittance(
        [350, 360, 400, 450, 500], [350, 400, 500], [0.0, 0.5, 0.9], 10.0
    )
    assert values[:2].tolist() == [np.inf, np.inf]
    assert values[2] == pytest.approx(np.log(2) / 10)
    assert values[3] == pytest.approx(-(np.log(0.5) + np.log(0.9)) / 20)
    assert extinction_index(values[2], 400.0) == pytest.approx(
        np.log(2) / 10 * 400e-6 / (4 * np.pi)
    )


@pytest.mark.peers
@pytest.mark.filterwarnings("ignore")  # of the peer, not ours
def test_opticalglass_agrees() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        factory = pytest.importorskip("opticalglass.glassfactory")
    wavelengths = [404.7, 486.1, 587.6, 656.3, 1014.0]
    for name in glass_names():
        glass = find_glass(name)
        if not glass.maker:
            continue
        other = factory.create_glass(name, glass.maker)
        np.testing.assert_allclose(
            glass.index(wavelengths), [other.rindex(w) for w in wavelengths], atol=1e-9
        )


@pytest.mark.peers
def test_full_catalogues_by_name() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pytest.importorskip("opticalglass.glassfactory")
    glass = find_glass("CDGM H-K9L")
    assert glass.maker == "CDGM"
    assert glass.index(587.5618) == pytest.approx(1.51680, abs=1e-5)
    assert 0 < glass.absorption(1500.0) < 0.01
    with pytest.raises(SceneError, match="no glass 'N-BK7' by Hoya"):
        find_glass("N-BK7", "Hoya")
