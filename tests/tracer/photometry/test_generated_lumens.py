"""Scenes drawn at random, recorded in watt and in lumen: every part of the product says the same.

The right lumens come from the map in watt by the formula of the International Lighting Vocabulary
(CIE S 017, 17-21-039): 683 lm/W Σ Φ V(λ), summed here over plain columns of rays. Seeds differ, so
that values agree within the standard error of their difference.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import query
import raymap
from query.answers.reports.energy import audit
from raymap import rayfiles
from raymap.optics.colorimetry import chromaticity, photopic
from tests.raymap.optics.test_lumen_squares import asked_of_paths
from tracer import record

SPECTRA = (
    "blackbody = {kelvin}",
    "led = {{ peak_nm = {peak}, width_nm = 40 }}",
    "lines = {{ wavelength_nm = [{first}, {last}], power = [1, {power:.2f}] }}",
)
FEW = 40
"""Fewer rays have no error that is worth comparing with."""


def drawn(seed: int) -> str:
    """A scene of two or three sources, a slab of dispersive glass, a filter and a coloured wall."""
    rng = np.random.default_rng(seed)
    nm = np.sort(rng.choice(np.arange(430, 690, 10), rng.integers(3, 7), replace=False)).tolist()

    def values(low: float = 0.05, high: float = 0.95) -> str:
        steps = rng.uniform(low, high, 4).round(3).tolist()
        return f"{{ wavelength_nm = [400, 500, 600, 700], value = {steps} }}"

    text = f"""
length_unit = "m"
flux_unit = "UNIT"
[spectrum]
kind = "spectral"
wavelengths_nm = {nm}
[surfaces.wall]
kind = "lambertian"
reflectance = {values()}
[surfaces.sheet]
kind = "filter"
index = 1.5
transmittance = {values()}
[surfaces.splitter]
kind = "mirror"
reflectance = {values()}
[media.flint]
glass = "N-SF11"
[bodies.glass]
kind = "box"
size = [3, 3, 0.2]
position = [0, 0, 0.1]
rotation = [{rng.uniform(0, 10):.2f}, 0, 0]
medium = "flint"
[bodies.sheet]
kind = "rectangle"
size = [3, 3]
position = [0, 0, 0.6]
surface = "sheet"
[bodies.wall]
kind = "rectangle"
size = [3, 3]
position = [0, 0, 1.2]
surface = "wall"
[bodies.side]
kind = "rectangle"
size = [3, 3]
position = [1.6, 0, 0.5]
rotation = [0, 90, 0]
surface = "splitter"
[detectors.plane]
position = [0, 0, 1.1]
looks = [0, 0, -1]
size = [3, 3]
cells = [2, 2]
[detectors.far]
kind = "far_field"
cells = [1, 4]
"""
    shares = rng.random() < 0.5
    for name in "abc"[: rng.integers(2, 4)]:
        spectrum = str(rng.choice(SPECTRA)).format(
            kelvin=rng.integers(2500, 9000),
            peak=rng.integers(450, 650),
            first=nm[0],
            last=nm[-1],
            power=rng.uniform(0.3, 3.0),
        )
        kind = str(rng.choice(["point", "lambertian", "collimated"]))
        text += f"""
[sources.{name}]
kind = "{kind}"
position = [{rng.uniform(-0.5, 0.5):.2f}, {rng.uniform(-0.5, 0.5):.2f}, -0.4]
flux = {rng.uniform(10, 100):.1f}
flux_unit = "lm"
spectrum = {{ {spectrum} }}
"""
        text += "" if kind == "point" else "diameter = 0.3\ndirection = [0, 0, 1]\n"
        text += f"share = {rng.integers(1, 5)}\n" if shares else ""
    return text


class Counted:
    """Lumens of the rays of a map in watt, from its columns alone."""

    def __init__(self, ray_map: raymap.RayMap) -> None:
        assert ray_map.directory.flux_unit == "W"
        self.emitted = ray_map.emitted
        fluxes = np.array([source.flux for source in ray_map.directory.sources])
        worth = 683.0 * photopic(ray_map.channel_sets[0].wavelengths_nm)
        ids, source, lumens, amounts = [], [], [], []
        for portion in ray_map.portions:
            n = len(worth)
            shares = np.concatenate((np.eye(n), portion.color_table() / 65535))
            color = shares[portion.column("color_code")[portion.record_offsets()[1:] - 1]]
            own = portion.column("source")
            watts = (fluxes / self.emitted)[own] * portion.column("weight")
            ids.append(portion.ray_ids())
            source.append(own)
            amounts.append(watts[:, None] * color)
            lumens.append(amounts[-1] @ worth)
        self.ids, self.source = np.concatenate(ids), np.concatenate(source)
        self.lumens, self.amounts = np.concatenate(lumens), np.concatenate(amounts)

    def of(self, ray_ids: Any) -> tuple[float, float, int]:
        """Lumens, their standard error and the number of some rays."""
        chosen = np.isin(self.ids, ray_ids)
        own, lumens = self.source[chosen], self.lumens[chosen]
        n = len(self.emitted)
        sums, squares = np.bincount(own, lumens, n), np.bincount(own, lumens**2, n)
        return sums.sum(), float(np.sqrt((squares - sums**2 / self.emitted).sum())), len(own)


def agree(name: str, a: tuple[float, float], b: tuple[float, float]) -> None:
    """Five standard errors of the difference; colours of sources are rounded to 1/65535."""
    bound = 5.0 * np.hypot(a[1], b[1]) + 2e-4 * abs(a[0])
    assert abs(a[0] - b[0]) <= bound, (name, a, b)


@pytest.mark.parametrize("seed", range(3))
def test_drawn_scenes_agree(seed: int, tmp_path: Path, run: Any) -> None:
    text = drawn(seed)
    results, paths = {}, {}
    for unit, number in (("W", 1), ("lm", 2)):
        scene = tmp_path / f"{unit}.toml"
        scene.write_text(text.replace("UNIT", unit), encoding="utf-8")
        paths[unit] = tmp_path / f"{unit}.raymap"
        results[unit] = record(scene, paths[unit], rays=20_000, seed=number, threads=1)
    with raymap.open(paths["W"]) as watt, raymap.open(paths["lm"]) as lumen:
        counted = Counted(watt)
        assert asked_of_paths(lumen, None, 'detected("plane")')
        assert lumen.merged is not None
        lit = [(colors > 0).sum(axis=1).max() for colors in lumen.merged.paths.sum_wc]
        assert max(lit) > 1
        sources_agree(counted, watt, lumen, results)
        selections_agree(counted, watt, lumen)
        pictures_agree(watt, lumen)
        exports_agree(lumen, tmp_path)
        commands_agree(paths, tmp_path, run)


def sources_agree(
    counted: Counted, watt: raymap.RayMap, lumen: raymap.RayMap, results: dict[str, Any]
) -> None:
    """What a trace and an audit say of each source."""
    whole = audit(lumen)
    for row, source in enumerate(lumen.directory.sources):
        name = source.name
        ended = results["lm"].fluxes["sources"][name]
        for column, kind in enumerate(query.answers.reports.energy.CLASSES):
            found = whole.flux[row, column], whole.flux_se[row, column]
            assert ended[kind]["flux"] == pytest.approx(found[0], rel=1e-6, abs=1e-9)
            assert ended[kind]["flux_se"] == pytest.approx(found[1], rel=1e-3, abs=1e-9)
        left = query.select(watt, f'source("{name}") & event(left)')
        *expected, rays = counted.of(left.ray_ids)
        if rays >= FEW:
            agree(
                f"{name} left", tuple(expected), (ended["left"]["flux"], ended["left"]["flux_se"])
            )
        # Lumens are not conserved where light changes colour; watts are
        assert whole.emitted_flux[row] == pytest.approx(source.flux, rel=1e-9)


def selections_agree(counted: Counted, watt: raymap.RayMap, lumen: raymap.RayMap) -> None:
    """Counts, path tables, ghosts."""
    texts = [None, 'detected("plane")', 'hit("sheet")', 'last(hit("wall"))', "length > 1.7 m"]
    for text in texts:
        *expected, rays = counted.of(query.select(watt, text).ray_ids)
        found = query.select(lumen, text).summary()
        if rays >= FEW:
            agree(str(text), tuple(expected), (found["flux"], found["flux_se"]))
            assert found["flux_se"] == pytest.approx(expected[1], rel=0.35, abs=1e-3)
    table = query.path_table(lumen)
    compared = 0
    for row in table.rows(12):
        if row.criterion is None:
            # The remainder
            continue
        *expected, rays = counted.of(query.select(watt, row.criterion).ray_ids)
        if min(rays, row.rays) >= FEW:
            compared += 1
            agree(row.path, tuple(expected), (row.flux, row.flux_se))
    assert compared
    assert sum(row.share for row in table.rows()) == pytest.approx(1.0)
    ghosts = query.ghost_table(lumen)
    *expected, rays = counted.of(ghost_rays(watt))
    assert min(rays, int(ghosts.rays.sum())) >= FEW
    agree("ghosts", tuple(expected), (ghosts.total, float(np.sqrt((ghosts.flux_se**2).sum()))))


def ghost_rays(ray_map: raymap.RayMap) -> list[int]:
    """Rays with two specular reflections at faces that let light pass, scattered nowhere."""
    mirror = [item.name for item in ray_map.directory.objects].index("side")
    scattered = sum(1 << bit for bit in (3, 4, 5, 8, 25))
    found: list[int] = []
    for portion in ray_map.portions:
        offsets, ids = portion.record_offsets(), portion.ray_ids()
        events, objects = portion.column("event"), portion.column("object")
        for ray, (start, end) in enumerate(itertools.pairwise(offsets)):
            here, item = events[start:end], objects[start:end]
            reflected = ((here & 2) != 0) & (item != mirror)
            if reflected.sum() == 2 and not (here & scattered).any():
                found.append(int(ids[ray]))
    return found


def pictures_agree(watt: raymap.RayMap, lumen: raymap.RayMap) -> None:
    """Lux, candela and chromaticity."""
    for name, kind in (("plane", "illuminance"), ("far", "candela")):
        images = [query.detector_image(each, name) for each in (watt, lumen)]
        (a, a_se), (b, b_se) = (image.quantity(kind)[:2] for image in images)
        for cell in np.ndindex(a.shape):
            if min(image.rays[cell] for image in images) < FEW:
                continue
            agree(f"{name} {cell}", (a[cell], a_se[cell]), (b[cell], b_se[cell]))
        xy = [chromaticity(image.xyz.sum(axis=(0, 1))) for image in images]
        rays = min(int(image.rays.sum()) for image in images)
        # Shares of channels scatter less than those of single lines: at most 0.4 / √rays
        np.testing.assert_allclose(*xy, atol=5 * 0.4 * np.sqrt(2.0 / rays))


def exports_agree(lumen: raymap.RayMap, folder: Path) -> None:
    """Ray files hold the lumens and the colours of the picture."""
    everything = query.select(lumen, None)
    plane = query.detector_image(lumen, "plane")
    query.write_ray_file(everything, folder / "a.tm25ray", "plane")
    rays = rayfiles.read(folder / "a.tm25ray")
    assert rays.total_flux == pytest.approx(plane.total, rel=1e-4)
    assert rays.tristimulus is not None
    np.testing.assert_allclose(
        chromaticity(rays.tristimulus.sum(axis=0).astype(float)),
        chromaticity(plane.xyz.sum(axis=(0, 1))),
        atol=1e-4,
    )


def commands_agree(paths: dict[str, Path], folder: Path, run: Any) -> None:
    """The same from the command line: image, chart, export."""
    cells, means = [], []
    for path in paths.values():
        assert run("image", path, "plane", "--kind", "illuminance", "-o", folder / "a.csv")[0] == 0
        table = np.loadtxt(folder / "a.csv", delimiter=",", skiprows=1)
        assert "illuminance [lx]" in (folder / "a.csv").read_text(encoding="utf-8")
        cells.append(table[:, 4:])
        code, out, _ = run("chart", path, "plane", "--luminous", "-o", folder / "a.png", "--json")
        assert code == 0
        said = json.loads(out)
        assert said["unit"] == "lx"
        means.append((said["mean"], said["mean_se"]))
        assert said["mean"] == pytest.approx(table[:, 4].mean(), rel=1e-5)
    for a, b in zip(*cells, strict=True):
        agree("image", tuple(a), tuple(b))
    agree("chart", *means)
    assert run("export", paths["lm"], "-o", folder / "a.parquet", "--rows", "segments")[0] == 0
    table = pq.read_table(folder / "a.parquet")
    facts = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    worth = np.array(json.loads(facts["raymap.worth"])[0])
    with raymap.open(paths["lm"]) as lumen:
        fluxes = {source.name: source.flux for source in lumen.directory.sources}
        emitted = json.loads(facts["raymap.emitted"])
        names = list(fluxes)
        last = np.append(np.diff(table["ray_id"].to_numpy()) != 0, True)
        source = np.array(table["source"].to_pylist())[last]
        color = np.array(table["color"].to_pylist())[last]
        weight = table["weight"].to_numpy()[last]
        flux = sum(
            fluxes[s] * w / emitted[s] * (c @ worth[names.index(s)])
            for s, w, c in zip(source, weight, color, strict=True)
        )
        assert flux == pytest.approx(query.select(lumen, None).flux, rel=1e-5)
