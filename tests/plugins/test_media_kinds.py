"""Media and phase functions of another distribution, each against what its formula says."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate, stats

from raymap.laws.phase import PhaseLaw, mean_cosine
from raymap.model.errors import SceneError
from tests.plugins.installing import HERE, ROOT, install, run
from tracer.media.phases.phase import Phase

DUSTS = [("dust", 0.5, 1.0), ("sharp", 0.95, 2.0), ("back", -0.4, 0.3)]


def draine(mu: Any, g: float, alpha: float) -> Any:
    """Density per solid angle: Draine (2003), eq. 4."""
    norm = (1.0 - g * g) / (4.0 * math.pi * (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0))
    return norm * (1.0 + alpha * mu**2) / (1.0 + g * g - 2.0 * g * mu) ** 1.5


def draine_cosine(g: float, alpha: float) -> float:
    """Mean cosine: Draine (2003), eq. 5."""
    top, bottom = 1.0 + alpha * (3.0 + 2.0 * g * g) / 5.0, 1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0
    return g * top / bottom


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("site"))


@pytest.fixture(scope="module")
def told(site: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    script = HERE / "media_of_kinds.py"
    done = run(site, str(script), str(tmp_path_factory.mktemp("maps")), folder=ROOT)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize(("name", "g", "alpha"), DUSTS)
def test_angles_are_drawn_from_the_formula(
    told: dict[str, Any], name: str, g: float, alpha: float
) -> None:
    cosines = np.array(told[name])
    assert len(cosines) > 30_000
    right = draine_cosine(g, alpha)
    assert abs(cosines.mean() - right) < 4.0 * cosines.std() / math.sqrt(len(cosines))
    # 50 bins that the formula fills alike
    mu = np.concatenate(([-1.0], 1.0 - np.geomspace(2.0, 1e-7, 200_000)[1:], [1.0]))
    filled = integrate.cumulative_simpson(2.0 * math.pi * draine(mu, g, alpha), x=mu, initial=0)
    assert filled[-1] == pytest.approx(1.0, abs=1e-6)
    edges = np.interp(np.linspace(0.0, 1.0, 51), filled / filled[-1], mu)
    counts, _ = np.histogram(np.clip(cosines, -1.0, 1.0), edges)
    assert stats.chisquare(counts).pvalue > 1e-3


@pytest.mark.parametrize(("name", "g", "alpha"), DUSTS)
def test_maps_store_a_table_that_is_the_formula(
    told: dict[str, Any], name: str, g: float, alpha: float
) -> None:
    law = PhaseLaw(**told[f"{name} law"])
    assert law.kind == "tabulated"
    mu = np.cos(np.radians(np.linspace(0.0, 180.0, 1801)))
    np.testing.assert_allclose(law.density(mu), draine(mu, g, alpha), rtol=2e-4)
    assert mean_cosine(*law.row()) == pytest.approx(draine_cosine(g, alpha), rel=1e-4)


def test_aimed_light_is_the_light_of_the_analog_mode(told: dict[str, Any]) -> None:
    (analog, s1), (aimed, s2) = told["side"], told["aimed"]
    assert 0.0 < max(s1, s2) < 0.1 * analog
    assert abs(analog - aimed) < 4.0 * math.hypot(s1, s2)


def test_a_pinhole_sees_the_beam_by_it(told: dict[str, Any]) -> None:
    # Light scattered once, in thin dust: flux through 1 mm² at 80 mm from the beam
    extinction, albedo, away = 1.0 / 20000.0, 0.9, 80.0

    def of_beam(z: float) -> float:
        r = math.hypot(away, 40.0 - z)
        lost = math.exp(-extinction * (z + r))
        return extinction * albedo * lost * draine((40.0 - z) / r, 0.5, 1.0) * away / r**3

    right, _ = integrate.quad(of_beam, 0.0, 40.0 + away * math.tan(math.radians(40.0)))
    value, error = told["seen"]
    assert 0.0 < error < 0.1 * right
    assert abs(value - right) < 4.0 * error


def test_a_medium_has_the_index_and_the_absorption_of_its_formulas(told: dict[str, Any]) -> None:
    wavelength = np.array([450.0, 550.0, 650.0])
    index: NDArray[np.float64] = (
        1.49 + 0.012 / (wavelength / 1e3) + 0.0008 / (wavelength / 1e3) ** 3.5
    )
    np.testing.assert_allclose(told["index"], index, rtol=1e-12)
    kappa = 2e-6 + (wavelength - 400.0) / 300.0 * 6e-6
    per_cm = 4.0 * math.pi * kappa / (wavelength * 1e-7)
    np.testing.assert_allclose(told["absorption"], per_cm, rtol=1e-12)
    # A slab of 20 mm at normal incidence, reflections between its faces added up
    reflected = ((index - 1.0) / (index + 1.0)) ** 2
    through = np.exp(-per_cm * 2.0)
    right = ((1.0 - reflected) * (1.0 - through) / (1.0 - reflected * through)).mean()
    value, error = told["absorbed"]
    assert 0.0 < error < 0.05 * right
    assert abs(value - right) < 4.0 * error
    assert told["kind"] == "conrady"


HEAD = 'length_unit = "mm"\n[sources.beam]\nkind = "collimated"\ndiameter = 1\n[media.m]\n'
DUST = HEAD + (
    "index = 1\nscattering = { mean_free_path = 5, phase = { kind = 'draine', g = 0.5 } }\n"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (DUST.replace("draine", "drain"), "there is no phase function 'drain'; did you mean"),
        (DUST.replace("g = 0.5", "h = 0.5"), "the draine phase function has no h; it takes g, al"),
        (DUST.replace("g = 0.5", "g = 1.5"), "media.m.scattering.phase.g: input should be less"),
        (HEAD + "conrady = [1.5, 0.01]", "media.m.conrady"),
        (HEAD + "conrady = [1, 0, 0]\nindex = 1", "give exactly one of index, sellmeier, cauchy"),
        (HEAD + "konrady = [1, 0, 0]", "media.m.konrady: unknown key; did you mean 'conrady'?"),
        (HEAD + "conrady = [-3, 0, 0]", "media.m: the refractive index must be positive, it is -3"),
        (HEAD + "index = 1\nkappa = 1e-6\nabsorption = 1", "give either"),
    ],
)
def test_slips_are_told_as_with_kinds_of_our_own(
    site: Path, tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    done = run(site, "-m", "raymap", "check", "scene.toml", folder=tmp_path)
    assert done.returncode == 1
    assert message in done.stderr


@pytest.mark.parametrize("sort", ["media", "phases"])
def test_the_tables_of_kinds_say_whose_they_are(site: Path, sort: str) -> None:
    done = run(site, "-m", "raymap", "kinds", sort)
    assert done.returncode == 0, done.stderr
    assert any(line.endswith("[raymap-example-kinds]") for line in done.stdout.splitlines())


class Spike(Phase):
    """A density that is no density, or no table."""

    kind: str = "spike"
    depth: float

    def density(self, mu: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.cos(4e4 * mu) + self.depth


@pytest.mark.parametrize(
    ("depth", "message"),
    [(0.5, "must be finite and not negative"), (1.5, "a table of 4096 angles misses it")],
)
def test_what_is_no_density_is_refused(depth: float, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Spike(depth=depth).stated()
