"""Imported lenses against an independent package: its reader, its ray trace, our indices."""

from __future__ import annotations

import re
import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
from tracer.importers.lens_scene import ImportedLens, import_lens
from tracer.importers.text import read_text
from tracer.run.recording import record
from tracer.scene.load import load_scene
from tracer.scene.model import Scene
from tracer.transport.trace import trace_rays

LENSES = Path(__file__).parents[2] / "data" / "lenses"
FILES = ["354710-C", "US05331467-1", "US05831776-1", "US08427765-1"]

pytestmark = [pytest.mark.peers, pytest.mark.filterwarnings("ignore")]


def opened(name: str) -> tuple[ImportedLens, Scene]:
    path = LENSES / f"{name}.zmx"
    return import_lens(path), load_scene(path)


@cache
def read_by_peer(name: str) -> Any:
    """The surfaces as the peer reads them; with model glasses, whose names it need not look up."""
    pytest.importorskip("optiland")
    text = read_text(LENSES / f"{name}.zmx")
    text = re.sub(r"GLAS (?!MIRROR)\S+ .*", "GLAS ___BLANK 1 0 1.5 50 0 0 0 0 0 0", text)
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")
        from optiland.fileio import load_zemax_file

        file = Path(folder) / "lens.zmx"
        file.write_text(text, encoding="utf-8")
        return load_zemax_file(str(file)).surfaces


class Peer:
    """The file as Optiland reads it, with the indices of our media."""

    def __init__(self, name: str, lens: ImportedLens, channel: int) -> None:
        self.group = read_by_peer(name)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from optiland.materials import IdealMaterial

            for k, surface in enumerate(self.group):
                surface.material_post = IdealMaterial(n=float(lens.sequence.indices[k, channel]))
        self.wavelength_um = lens.prescription.wavelengths_nm[channel] / 1000.0

    def points(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(n_surfaces, n_rays, 3) of given rays."""
        from optiland.rays import RealRays

        n = len(origins)
        rays = RealRays(*origins.T, *directions.T, np.ones(n), np.full(n, self.wavelength_um))
        self.group.trace(rays)
        return np.stack([self.group.x, self.group.y, self.group.z], axis=-1)


def design_rays(lens: ImportedLens) -> tuple[np.ndarray, np.ndarray]:
    """Chief rays, rays at the edge of the pupil and within, of all fields, from before."""
    origins, directions = [], []
    for field in lens.bundles.origins:
        chief, edge = lens.bundles.chief(field), lens.bundles.edge(field)
        places = np.vstack([chief, edge, 0.3 * chief + 0.7 * edge])
        p, d = lens.bundles.launch(field, places)
        if field.slope is not None:
            p = p - 5.0 / d[:, 2:] * d
        origins.append(p)
        directions.append(d)
    return np.concatenate(origins), np.concatenate(directions)


@pytest.mark.parametrize("name", FILES)
def test_chief_and_marginal_rays_agree_at_every_surface(name: str) -> None:
    compare_rays(name, every_wavelength=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_rays_agree_at_every_wavelength(name: str) -> None:
    compare_rays(name, every_wavelength=True)


def compare_rays(name: str, *, every_wavelength: bool) -> None:
    lens, scene = opened(name)
    origins, directions = design_rays(lens)
    faces = lens.elements.face_of
    last = len(lens.prescription.surfaces) - 1
    met = [
        k
        for k, surface in enumerate(lens.prescription.surfaces)
        if surface.number in faces or k == last
    ]
    for channel, wavelength in enumerate(lens.prescription.wavelengths_nm):
        if not (every_wavelength or channel == lens.prescription.primary):
            continue
        expected = Peer(name, lens, channel).points(origins, directions)
        # In the order of the file: every surface, the stop and dummies too
        ours = lens.sequence.trace(origins, directions, channel).points
        assert np.abs(ours[1:] - expected[1:]).max() < 1e-6
        # As bodies in space, light choosing its own way
        traced = trace_rays(scene, origins, directions, wavelength_nm=wavelength)
        image = traced.object_names.index("image")
        names = [faces[lens.prescription.surfaces[k].number].split(".")[0] for k in met[:-1]]
        compared = 0
        for ray in range(len(origins)):
            rows = slice(traced.offsets[ray] + 1, traced.offsets[ray + 1])
            if traced.object[rows][-1] != image:
                continue  # clipped by an edge, as its aperture says
            assert [traced.object_names[o] for o in traced.object[rows]] == [*names, "image"]
            assert np.abs(traced.points[rows] - expected[met, ray]).max() < 1e-6
            compared += 1
        assert compared >= 0.4 * len(origins)


@pytest.mark.parametrize(
    "name", [FILES[0], *(pytest.param(name, marks=pytest.mark.slow) for name in FILES[1:])]
)
def test_the_recorded_spot_is_that_of_the_peer(name: str, tmp_path: Path) -> None:
    lens, scene = opened(name)
    record(scene, tmp_path / "lens.raymap", rays=6000, seed=3, threads=1)
    faces = lens.elements.face_of
    with raymap.open(tmp_path / "lens.raymap") as map_:
        assert [source.name for source in map_.directory.sources] == list(scene.sources)
        names = [item.name for item in map_.directory.objects]
        design = [
            names.index(faces[surface.number].split(".")[0])
            for surface in lens.prescription.surfaces
            if surface.number in faces
        ]
        design.append(names.index("image"))
        portion = map_.portions[0].read()
        color = map_.portions[0].column("color")
    first = np.concatenate(([0], np.cumsum(portion.records_per_ray, dtype=np.int64)))
    # Rays that went the way of the design, by source and wavelength
    rays = [
        ray
        for ray in np.flatnonzero(portion.records_per_ray == len(design) + 1)
        if np.array_equal(portion.object[first[ray] + 1 : first[ray + 1]], design)
    ]
    start, end = first[rays], first[np.array(rays) + 1] - 1
    positions = portion.position.astype(float)
    channel = np.argmax(color[end], axis=1)
    along = positions[start + 1] - positions[start]
    along /= np.linalg.norm(along, axis=1)[:, None]
    compared = 0
    for source in range(len(scene.sources)):
        for c in range(len(lens.prescription.wavelengths_nm)):
            mine = (portion.source[rays] == source) & (channel == c)
            spot = positions[end][mine][:, :2]
            if len(spot) < 30:
                continue
            theirs = Peer(name, lens, c).points(positions[start][mine], along[mine])[-1, :, :2]
            # Single precision of the recorded places limits how well the rays can be repeated
            size = np.sqrt(np.mean(np.sum((spot - spot.mean(axis=0)) ** 2, axis=1)))
            other = np.sqrt(np.mean(np.sum((theirs - theirs.mean(axis=0)) ** 2, axis=1)))
            assert other == pytest.approx(size, rel=0.01, abs=2e-5)
            assert np.abs(theirs.mean(axis=0) - spot.mean(axis=0)).max() < 2e-5 + 0.01 * size
            compared += 1
    assert compared >= len(scene.sources)
