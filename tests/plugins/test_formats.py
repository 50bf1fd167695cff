"""File formats of another distribution: read by the commands, listed, named where others fail."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.plugins.installing import install, run

SCENE = """
length_unit = "mm"
flux_unit = "lm"
[sources.lamp]
kind = "intensity"
file = "lamp.cdt"
[detectors.far]
kind = "far_field"
axis = [0, 0, 1]
cells = [1, 9]
gamma_deg = [0, 90]
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("site"))


def told(site: Path, folder: Path, *words: str) -> dict:
    done = run(site, "-m", "raymap", *words, "--json", folder=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("name", ["lamp.cdt", "lamp.txt"])
def test_light_is_read_by_suffix_or_by_its_first_bytes(
    site: Path, tmp_path: Path, name: str
) -> None:
    # Intensity I0 everywhere in the half space: flux 2 pi I0
    (tmp_path / name).write_text("# candela table\n0 100\n90 100\n", encoding="utf-8")
    code = (
        "from pathlib import Path; from tracer.light import read_light; "
        f"print(read_light(Path({name!r})).flux)"
    )
    done = run(site, "-c", code, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == pytest.approx(628.31853, rel=1e-6)


def test_a_scene_takes_it(site: Path, tmp_path: Path) -> None:
    (tmp_path / "lamp.cdt").write_text("# candela table\n0 100\n90 100\n", encoding="utf-8")
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
    found = told(site, tmp_path, "check", "scene.toml")
    [source] = found["sources"] if isinstance(found["sources"], list) else found["sources"].items()
    assert "628.3" in json.dumps(source)


def test_a_lens_opens_as_a_scene_and_has_its_focal_length(site: Path, tmp_path: Path) -> None:
    (tmp_path / "a.onelens").write_text("50 -50 5 1.5 5 47.4", encoding="utf-8")
    found = told(site, tmp_path, "check", "a.onelens")
    # Lens maker: 1/f = (n - 1) (1/R1 - 1/R2 + (n - 1) d / (n R1 R2))
    power = 0.5 * (2 / 50 - 0.5 * 5 / (1.5 * 50 * 50))
    assert found["design"]["efl"] == pytest.approx(1 / power, rel=1e-4)


def test_a_mesh_has_its_faces(site: Path, tmp_path: Path) -> None:
    # A tetrahedron with three right angles at the origin: areas 1/2 three times, and sqrt(3) / 2
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    lines = (
        " ".join(str(x) for corner in face for x in corners[corner])
        for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    )
    (tmp_path / "a.tri").write_text("\n".join(lines), encoding="utf-8")
    [body] = told(site, tmp_path, "faces", "a.tri")["bodies"]
    assert sum(face["area"] for face in body["faces"]) == pytest.approx(1.5 + 3**0.5 / 2)


def test_what_another_program_traced_becomes_a_map(site: Path, tmp_path: Path) -> None:
    (tmp_path / "a.pts").write_text("1 0 0 0\n1 0 0 8\n2 0 0 0\n2 3 0 4\n", encoding="utf-8")
    assert told(site, tmp_path, "import", "a.pts", "-o", "a.raymap")["rays"] == 2
    long = told(site, tmp_path, "query", "a.raymap", "length > 7")
    assert long["matched"] == 1
    legs = told(site, tmp_path, "query", "a.raymap", "longest_leg == 5 mm")
    assert legs["matched"] == 1


def test_they_are_named_where_a_file_is_of_no_known_format(site: Path, tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("nothing", encoding="utf-8")
    done = run(site, "-m", "raymap", "import", "a.xyz", "-o", "a.raymap", folder=tmp_path)
    assert done.returncode == 1
    assert "known formats are .zrd, .pts" in done.stderr
    done = run(site, "-m", "raymap", "faces", "a.xyz", folder=tmp_path)
    assert done.returncode == 1
    assert ".onelens" in done.stderr
    (tmp_path / "scene.toml").write_text(SCENE.replace(".cdt", ".xyz"), encoding="utf-8")
    done = run(site, "-m", "raymap", "check", "scene.toml", folder=tmp_path)
    assert done.returncode == 1
    assert ".cdt" in done.stderr
