"""Zemax ray databases: trees as rays, energy, events, names; files that lie."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import query
import raymap
from raymap.file.verify import verify
from raymap.foreign.zrd import SEGMENT, ZrdError
from raymap.foreign.zrd_map import import_zrd
from raymap.model.errors import MapExists, RayMapError
from raymap.model.events import Event

SOURCE, PLATE, WALL = 1, 2, 5
INDEX = 1.5
R = 0.04


def segment(**values: Any) -> dict[str, Any]:
    return {"nx": 0.0, "ny": 0.0, "nz": 0.0, "index": 1.0, "intensity": 0.0} | values


def tree(y: float, slope: float = 0.3, intensity: float = 0.1) -> list[dict[str, Any]]:
    """A ray that splits at the front (z = 0) and the back (z = 1) of a plate of index 1.5.

    Its back absorbs a tenth; what goes through ends on a wall at z = 3, what returns misses.
    """
    d = np.array([0.0, slope, np.sqrt(1 - slope**2)])
    sin_t = slope / INDEX
    t = np.array([0.0, sin_t, np.sqrt(1 - sin_t**2)])
    start = np.array([0.0, y, -1.0])
    front = start + d / d[2]
    back = front + t / t[2]
    wall = back + 2 * d / d[2]
    up = back * np.array([1, 1, 0]) + t * np.array([0, 1, 0]) / t[2]
    again = up + t / t[2]
    m = np.array([1, 1, -1])

    def at(
        point: Any, along: Any, hit: int, face: int, parent: int, flux: float, **more: Any
    ) -> Any:
        keys = dict(zip("xyz", point, strict=True)) | dict(zip("lmn", along, strict=True))
        return segment(
            hit_object=hit, hit_face=face, parent=parent, intensity=flux * intensity, **keys, **more
        )

    inside = {"in_object": PLATE, "index": INDEX}
    return [
        at(start, d, SOURCE, 0, 0, 1.0),
        at(front, d, PLATE, 1, 0, 1.0, nz=-1.0),
        at(front + 5 * m * d, m * d, 0, 0, 1, R),
        at(back, t, PLATE, 2, 1, 1 - R, nz=1.0, **inside),
        at(wall, d, WALL, 0, 3, (1 - R) * 0.86, nz=-1.0, status=1),
        at(up, m * t, PLATE, 1, 3, (1 - R) * 0.04, nz=-1.0, **inside),
        at(up + 5 * m * d, m * d, 0, 0, 5, (1 - R) * 0.04 * (1 - R)),
        at(again, t, PLATE, 2, 5, (1 - R) * 0.04 * R, nz=1.0, status=1, **inside),
    ]  # fmt: skip


def write_zrd(path: Path, trees: list[list[dict[str, Any]]], version: int = 2002) -> Path:
    raw = struct.pack("<ii", version, max(map(len, trees)) + 5)
    for rows in trees:
        data = np.zeros(len(rows), SEGMENT[version])
        for k, row in enumerate(rows):
            data[k]["level"] = k
            for name, value in row.items():
                data[k][name] = value
        raw += struct.pack("<i", len(rows)) + data.tobytes()
    path.write_bytes(raw)
    return path


NAMES = {"1": "lamp", "2": "plate", "2.1": "front", "2.2": "back", "5": "wall"}
TREES = [tree(0.1 * k, intensity=0.1 + 0.01 * k) for k in range(20)]
TOTAL = sum(rows[0]["intensity"] for rows in TREES)


@pytest.mark.parametrize("version", [2002, 2003])
def test_energy_is_what_the_database_says(tmp_path: Path, version: int) -> None:
    file = write_zrd(tmp_path / "a.ZRD", TREES, version)
    written = import_zrd(file, tmp_path / "a.raymap", names=NAMES)
    assert written["trees"] == 20
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert not verify(ray_map).damage
        assert ray_map.emitted.tolist() == [20]

        def flux(criterion: str) -> float:
            return query.select(ray_map, criterion).flux / TOTAL

        assert query.select(ray_map).flux == pytest.approx(TOTAL)
        assert flux('hit("plate.front")') == pytest.approx(1)
        assert flux('last(hit("wall", absorbed))') == pytest.approx((1 - R) * 0.86)
        assert flux('hit("plate.front", reflected) & !medium("in plate")') == pytest.approx(R)
        assert flux('last(hit("plate.back", absorbed)) & !hit("plate.back", reflected)') == (
            pytest.approx((1 - R) * 0.1)
        )
        assert flux('event(left) & hit("plate.back", reflected)') == pytest.approx(
            (1 - R) ** 2 * 0.04
        )
        selected = query.select(ray_map, 'hit("wall")')
        assert selected.flux_se < 0.1 * selected.flux


def test_points_and_events(tmp_path: Path) -> None:
    file = write_zrd(tmp_path / "a.zrd", TREES[:1])
    import_zrd(file, tmp_path / "a.raymap", names=NAMES, length_unit="in", flux_unit="lm")
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert (ray_map.directory.length_unit, ray_map.directory.flux_unit) == ("in", "lm")
        (through,) = query.select(ray_map, 'hit("wall")').ray_ids
        points = query.report(ray_map, through)["points"]
        assert [point["object"] for point in points] == [None, "plate", "plate", "wall"]
        assert [point["face"] for point in points] == [None, "front", "back", "face_0"]
        assert points[1]["events"] == ["refracted", "medium_changed"]
        assert points[2]["events"] == ["refracted", "medium_changed"]
        assert [point["medium"] for point in points[:3]] == ["background", "in plate", "background"]
        np.testing.assert_allclose(points[2]["position"][2], 1, atol=1e-6)
        assert points[1]["refractive_index"] == pytest.approx(1.5)
        # Rays that meet nothing end on the bounding sphere
        sphere = ray_map.directory.bounding_sphere
        stored = ray_map.portions[0]
        left = (stored.column("event") & int(Event.LEFT_SCENE)) != 0
        away = stored.column("position")[left] - np.array(sphere.center)
        np.testing.assert_allclose(np.linalg.norm(away, axis=1), sphere.radius, rtol=1e-5)


def test_scattered_and_bulk_scattered(tmp_path: Path) -> None:
    rows = tree(0.0)[:2]
    rows.append(segment(hit_object=0, parent=1, x=0, y=2, z=-1, intensity=0.1))
    rows.append(segment(hit_object=WALL, parent=2, x=1, y=2, z=3, nz=-1, intensity=0.1))
    file = write_zrd(tmp_path / "a.zrd", [rows])
    import_zrd(file, tmp_path / "a.raymap", names={"5": "wall"})
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert query.select(ray_map, 'hit("object_2", diffuse_reflection)').matched == 1
        assert query.select(ray_map, "event(volume_scatter)").matched == 1
        assert ray_map.rays == 1


@pytest.mark.peers
def test_a_file_that_another_library_writes(tmp_path: Path) -> None:
    with warnings.catch_warnings(action="ignore"):
        zfileutils = pytest.importorskip("pyzdde.zfileutils")
    rays = []
    for rows in TREES:
        ray = zfileutils.ZemaxRay()
        ray.zrd_version, ray.n_segments = 2002, 8
        for row in rows:
            for name, _ in ray.uncompressed_zrd:
                kind = int if SEGMENT[2002][name].kind == "i" else float
                getattr(ray, name).append(kind(row.get(name, 0)))
        rays.append(ray)
    zfileutils.writeZRDFile(rays, str(tmp_path / "theirs.zrd"), "uncompressed")
    ours = write_zrd(tmp_path / "ours.zrd", TREES)
    import_zrd(tmp_path / "theirs.zrd", tmp_path / "theirs.raymap")
    import_zrd(ours, tmp_path / "ours.raymap")
    with (
        raymap.open(tmp_path / "theirs.raymap") as a,
        raymap.open(tmp_path / "ours.raymap") as b,
    ):
        for one, other in zip(a.portions, b.portions, strict=True):
            assert np.array_equal(one.segments(), other.segments())
            assert np.array_equal(one.column("weight"), other.column("weight"))
    found = zfileutils.readZRDFile(str(ours))
    assert [len(ray.x) for ray in found] == [8] * 20


def changed(raw: bytes, offset: int, form: str, *values: float) -> bytes:
    data = bytearray(raw)
    struct.pack_into(form, data, offset, *values)
    return bytes(data)


FIRST = 12
LIES = {
    "too short": lambda raw: raw[:5],
    "holds no ray": lambda raw: raw[:8],
    "compressed full data": lambda raw: changed(raw, 0, "<i", 22002),
    "compressed basic data": lambda raw: changed(raw, 0, "<i", 12003),
    "not a Zemax ray database": lambda raw: b"TM25" + raw[4:],
    "begins with 1999": lambda raw: changed(raw, 0, "<i", 1999),
    "has 2000000000 segments": lambda raw: changed(raw, 8, "<i", 2_000_000_000),
    "has 0 segments": lambda raw: changed(raw, 8, "<i", 0),
    "at byte": lambda raw: raw[:-1],
    "ray 1: x is not a number": lambda raw: changed(raw, FIRST + 208 + 56, "<d", float("nan")),
    "continues no segment before it": lambda raw: changed(raw, FIRST + 208 + 24, "<i", 7),
    "negative": lambda raw: changed(raw, FIRST + 208 + 136, "<d", -1.0),
}


@pytest.mark.parametrize("what", LIES)
def test_files_that_lie(tmp_path: Path, what: str) -> None:
    raw = write_zrd(tmp_path / "good.zrd", TREES[:2]).read_bytes()
    bad = tmp_path / "bad.zrd"
    bad.write_bytes(LIES[what](raw))
    with pytest.raises(ZrdError) as error:
        import_zrd(bad, tmp_path / "bad.raymap")
    assert what in str(error.value)
    assert "\n" not in str(error.value)
    assert sorted(each.suffix for each in tmp_path.iterdir()) == [".zrd", ".zrd"]


def test_names_that_nothing_has(tmp_path: Path) -> None:
    file = write_zrd(tmp_path / "a.zrd", TREES[:2])
    with pytest.raises(RayMapError, match=r"no ray of a.zrd meets '7'; they meet 1, 2, 2.1, 2.2"):
        import_zrd(file, tmp_path / "a.raymap", names={"7": "baffle"})
    import_zrd(file, tmp_path / "a.raymap")
    with pytest.raises(MapExists):
        import_zrd(file, tmp_path / "a.raymap")


def test_the_command(tmp_path: Path, run: Any) -> None:
    file = write_zrd(tmp_path / "a.zrd", TREES)
    names = tmp_path / "names.toml"
    names.write_text('2 = "plate"\n"2.1" = "front"\n')
    code, text, error = run("import", file, "-o", tmp_path / "a.raymap", "--names", names)
    assert code == 0, error
    assert "of 20 ray trees" in text
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert "plate.front" in ray_map.describe()["faces"]
    code, _, error = run("import", names, "-o", tmp_path / "b.raymap")
    assert (code, error.count("\n")) == (1, 1)
