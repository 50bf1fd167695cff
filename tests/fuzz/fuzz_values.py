"""Fuzzing with valid checksums: ``NUMBA_BOUNDSCHECK=1 python tests/fuzz/fuzz_values.py [seconds]``.

A small map is taken apart into the values of its columns, headers and JSON texts. Some of them are
changed, all checksums, sizes and the footer's index are made to fit again, and the map is opened,
read, asked and verified. Whatever the values say:

- nothing but the project's own errors is raised, and `verify` raises none;
- no compiled loop leaves its arrays (run with Numba's bounds checks, or this proves nothing of it);
- where a single value was changed that the map says twice, `verify` finds it;
- where a single value was changed that stands for itself, it is read back exactly.

Cases are numbered and drawn from their number alone: ``--first N --cases 1`` repeats one. They run
in another process, whose end by a signal is a finding like any other.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import json
import random
import struct
import sys
from dataclasses import dataclass, field
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(_ROOT))

import numpy as np  # noqa: E402
import xxhash  # noqa: E402

import raymap  # noqa: E402
from raymap.bytes.chunks import MapFile  # noqa: E402
from raymap.bytes.layout import (  # noqa: E402
    FILE_HEADER_SIZE,
    FOOTER,
    PORTION,
    TAIL_MAGIC,
    StreamEntry,
    header_size,
    pack_chunk_header,
    pack_file_header,
)
from raymap.bytes.streams import STORED, WHOLE, decode_column, kind_of  # noqa: E402
from raymap.file.repair import repair  # noqa: E402
from raymap.file.verify import verify  # noqa: E402
from tests.fuzz.questions import ask  # noqa: E402
from tests.fuzz.supervised import command_line  # noqa: E402
from tests.raymap.compact import write_compactly  # noqa: E402
from tests.raymap.maps import COLORED, RGB, portion_at, small_directory, write_small  # noqa: E402

_JSON = ("json",)

_STATED_TWICE = (
    "path.rays",
    "path.sum_w",
    "path.sum_w2",
    "path.sum_c",
    "path.sum_wc",
    "path.sum_wy2",
    "portion.n_rays",
    "portion.n_records",
    "portion.emitted",
    "portion.first_ray",
    "portion.offset",
    "portion.size",
    "portion.head_size",
    "chunk.size",
    "chunk.head_size",
    "portion.flags",
    "local_to_global",
    "chunk.offset",
    "chunk.tag",
    "sums",
    "sums2",
)
"""Columns of which every value follows from others."""

_FREE = {"weight": "weight", "emission": "emission", "x:phase": "phase", "x:lobe": "lobe"}
"""Columns of plain portions that stand for themselves."""


@dataclass
class Stream:
    """A column as values; opaque text as bytes in ``values``."""

    name: str
    kind: int
    scope: int
    width: int
    values: np.ndarray


@dataclass
class Part:
    """A chunk taken apart."""

    tag: bytes
    offset: int
    meta: bytes
    streams: list[Stream] = field(default_factory=list)


def take_apart(path: Path) -> list[Part]:
    """The chunks of a sound map as values."""
    file = MapFile(path)
    parts = []
    for chunk in file.walk(FILE_HEADER_SIZE, file.size):
        part = Part(chunk.tag, chunk.offset, chunk.header.meta)
        names = dict.fromkeys(entry.name for entry in chunk.header.streams)
        for name in names:
            entries = [entry for entry in chunk.header.streams if entry.name == name]
            values = decode_column(entries, lambda entry, chunk=chunk: file.stored(chunk, entry))
            first = entries[0]
            part.streams.append(Stream(name, first.kind, first.scope, first.width, values))
        parts.append(part)
    file.close()
    return parts


def put_together(parts: list[Part]) -> bytes:
    """A map with sound checksums, sizes, and an index that says where the chunks stand."""
    out = bytearray(pack_file_header())
    places: dict[int, tuple[int, int, int]] = {}
    for part in parts:
        if part.tag == FOOTER:
            continue
        packed = _pack(part)
        places[part.offset] = len(out), len(packed), header_size(packed)
        out += packed
    for part in parts:
        if part.tag == FOOTER:
            out += _pack_footer(part, places)
    return bytes(out)


def _pack(part: Part) -> bytes:
    entries, buffers = [], []
    for stream in part.streams:
        content = np.ascontiguousarray(stream.values).tobytes()
        digest = xxhash.xxh3_64_intdigest(content)
        entries.append(
            StreamEntry(
                stream.name, stream.kind, STORED, WHOLE, stream.scope, stream.width,
                len(content), len(content), digest,
            )
        )  # fmt: skip
        buffers.append(content)
    return pack_chunk_header(part.tag, part.meta, entries) + b"".join(buffers)


def _pack_footer(part: Part, places: dict[int, tuple[int, int, int]]) -> bytes:
    """The footer with the places of the chunks as they are now; changed ones stay changed."""
    moved = dataclasses.replace(
        part,
        streams=[dataclasses.replace(each, values=each.values.copy()) for each in part.streams],
    )
    by_name = {stream.name: stream for stream in moved.streams}
    for kind in ("portion", "chunk"):
        stream = by_name.get(f"{kind}.offset")
        if stream is None or stream.values.ndim != 1 or stream.values.dtype.kind not in "iu":
            continue
        for row, old in enumerate(stream.values.tolist()):
            if old not in places:
                continue
            stream.values[row] = min(places[old][0], np.iinfo(stream.values.dtype).max)
            for number, name in ((1, "size"), (2, "head_size")):
                sizes = by_name.get(f"{kind}.{name}")
                if sizes is None or sizes.values.ndim != 1 or row >= len(sizes.values):
                    continue
                if sizes.values[row] == 0:
                    most = (
                        np.iinfo(sizes.values.dtype).max if sizes.values.dtype.kind in "iu" else 1
                    )
                    sizes.values[row] = min(places[old][number], most)
    moved.streams = [stream for stream in moved.streams if stream.name != "tail"]
    tail = Stream("tail", 0, 0, 1, np.zeros(24, np.uint8))
    moved.streams.append(tail)
    size = len(_pack(moved))
    check = xxhash.xxh3_64_intdigest(struct.pack("<Q", size) + TAIL_MAGIC)
    tail.values = np.frombuffer(struct.pack("<QQ8s", size, check, TAIL_MAGIC), np.uint8)
    return _pack(moved)


class Seed:
    """A sound small map, taken apart; sizes of portions are left for the sealing to fill in."""

    def __init__(self, name: str, path: Path) -> None:
        self.name, self.parts = name, take_apart(path)
        for part in self.parts:
            for stream in part.streams if part.tag == FOOTER else ():
                if stream.name.endswith(("n.size", "k.size", ".head_size")):
                    stream.values = np.zeros_like(stream.values)


def seeds(folder: Path) -> list[Seed]:
    """Small maps of every encoding."""
    found = []
    for number, options in enumerate(
        (
            {},
            {"n_paths": None},
            {"weighted": True, "extra": True},
            {"n_paths": None, "weighted": True, "extra": True, "grouped": True},
            {"weighted": True, "grouped": True, "with_ids": False},
            {
                "weighted": True,
                "directory": small_directory(flux_unit="lm"),
                "channels": COLORED,
            },
        )
    ):
        path = folder / f"seed{number}.raymap"
        write_small(path, n_portions=2, n_rays=7, seed=number, **options)
        found.append(Seed(f"small {options}", path))
    path = folder / "compact.raymap"
    _write_compact(path)
    found.append(Seed("compact", path))
    path = folder / "described.raymap"
    write_small(path, n_portions=1, n_rays=9, seed=9, directory=_described())
    found.append(Seed("described", path))
    return found


def _described() -> raymap.Directory:
    """Detectors of all kinds, surfaces and sources with parameters that are read."""
    plane = {"acceptance_deg": 30.0, "size_unit": "cm"}
    sky = {"gamma_deg": [0.0, 180.0], "angles": "type_c", "size_unit": "deg"}
    camera = {"half_field": [0.5, 0.4], "lens": "thin", "size_unit": "tangent"}
    face = {"cell_area": [0.5] * 48, "mapping": "around"}
    side = {"cell_area": [0.5] * 6, "mapping": "around"}
    glass = {
        "area_law": {
            "kind": "revolution",
            "inner": 0.5,
            "outer": 2.0,
            "curvature": 0.2,
            "conic": -1.0,
            "aspheric": [1e-3, 1e-5],
        },
        "mapping": "across",
    }
    end = {"area_law": {"kind": "polygon", "corners": [[-2.0, -2.0], [2.0, -2.0], [0.0, 2.0]]}}
    turned = {"reflected": {"kind": "tabulated", "albedo": 0.3}, "share": [0.1, 0.2, 0.3]}
    return small_directory(
        detectors=(
            raymap.Detector(name="sensor", cells=(8, 6), size=(40.0, 40.0), parameters=plane),
            raymap.Detector(name="sky", kind="far_field", cells=(8, 6), parameters=sky),
            raymap.Detector(
                name="eye", kind="camera", cells=(8, 6),
                parameters={**camera, "aperture_diameter": 2.0, "focus_distance": 100.0},
            ),
            raymap.Detector(
                name="hole", kind="camera", cells=(8, 6), parameters={**camera, "lens": "pinhole"}
            ),
            raymap.Detector(name="wall", kind="surface", cells=(8, 6), parameters=face),
            raymap.Detector(name="side", kind="surface", cells=(8, 6), parameters=side),
            raymap.Detector(
                name="glass", kind="surface", cells=(8, 6), size=(4.0, 4.0), parameters=glass
            ),
            raymap.Detector(
                name="end", kind="surface", cells=(8, 6), size=(4.0, 4.0), parameters=end
            ),
        ),
        sources=(
            raymap.Source(name="lamp", flux=2.0, parameters={"diameter": 3.0, "size": [1.0, 2.0]}),
            raymap.Source(name="sun", parameters={"radius": 1.0}),
        ),
        surfaces=(
            raymap.Surface(name="paint", kind="lambertian", parameters={"reflectance": 0.2}),
            raymap.Surface(name="film", kind="dielectric", parameters=turned),
        ),
    )  # fmt: skip


def _write_compact(path: Path) -> None:
    """A map whose positions, normals and crossings lean on shapes: the most that is decoded."""
    rows = [portion_at(0, 9, seed=5, n_paths=3), portion_at(100, 9, seed=6, n_paths=None)]
    sphere = raymap.Quadric(coefficients=(1, 1, 1, 0, 0, 0, 0, 0, 0, -2500.0), solve_axis=2)
    faces = (
        raymap.Face(name="front", quadrics=(sphere,)),
        raymap.Face(name="mesh", first_primitive=1, primitive_count=9, quadrics=(sphere,) * 9),
    )
    lens = raymap.SceneObject(name="lens", faces=faces)
    directory = small_directory(objects=(lens, raymap.SceneObject(name="box")))
    with raymap.RayMapWriter.create(path, directory) as writer:
        write_compactly(writer)
        writer.add_channel_set(RGB)
        writer.start_run(seed=1, parameters={})
        for row in rows:
            writer.append(_on_sphere(row))
        writer.finish({})
    # Made again, it has the sums of its detectors, too
    with raymap.open(path) as ray_map:
        repair(ray_map, path.with_suffix(".new"))
    path.with_suffix(".new").replace(path)


def _on_sphere(portion: raymap.Portion) -> raymap.Portion:
    """The portion with its points on the sphere and its crossings where segments cross."""
    position = portion.position.astype(np.float64)
    position *= 50.0 / np.maximum(np.linalg.norm(position, axis=1, keepdims=True), 1e-9)
    normal = np.rint(position / 50.0 * 32767).astype(np.int16)
    return dataclasses.replace(portion, position=position.astype(np.float32), normal=normal)


# -- changes -------------------------------------------------------------------------------------


@dataclass
class Change:
    """One value that was changed."""

    tag: bytes
    stream: str
    row: int
    part: int


def change(parts: list[Part], dice: random.Random) -> Change:
    """Change one value somewhere."""
    number = dice.randrange(len(parts))
    part = parts[number]
    if part.meta and dice.random() < 0.15:
        meta = bytearray(part.meta)
        place = 4 * dice.randrange(max(1, len(meta) // 4))
        meta[place : place + 4] = struct.pack("<I", _odd_number(dice) & 0xFFFFFFFF)
        part.meta = bytes(meta)[: len(part.meta)]
        return Change(part.tag, "", place, number)
    usual = [stream for stream in part.streams if stream.name != "tail"]
    if not usual:
        return Change(part.tag, "", -1, number)
    stream = dice.choice(usual)
    if stream.name in _JSON:
        _change_text(stream, dice)
        return Change(part.tag, "json", 0, number)
    kind = dice.random()
    if kind < 0.08:
        _change_rows(stream, dice)
        return Change(part.tag, stream.name, -1, number)
    if kind < 0.11:
        _change_table(part, stream, dice)
        return Change(part.tag, stream.name, -1, number)
    flat = stream.values.reshape(-1)
    if not len(flat):
        return Change(part.tag, stream.name, -1, number)
    flat = flat.copy()
    row = dice.randrange(len(flat))
    with np.errstate(over="ignore"):
        flat[row] = _odd_value(flat, row, dice)
    stream.values = flat.reshape(stream.values.shape)
    return Change(part.tag, stream.name, row, number)


def _odd_number(dice: random.Random) -> int:
    return dice.choice(
        (0, 1, 2, -1, 127, 128, 255, 32767, 32768, 65535, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
    )


def _odd_value(flat: np.ndarray, row: int, dice: random.Random) -> object:
    dtype = flat.dtype
    if dtype == np.bool_:
        return not flat[row]
    if dtype.kind in "iu":
        info = np.iinfo(dtype)
        near = int(flat[row]) + dice.choice((-1, 1, -2, 2, 8, -8))
        value = dice.choice(
            (near, near, int(dice.choice(flat)), info.min, info.max, _odd_number(dice),
             dice.randint(info.min, info.max))
        )  # fmt: skip
        return min(max(value, info.min), info.max)
    value = float(np.real(flat[row]))
    return dice.choice(
        (np.nan, np.inf, -np.inf, -value, 2 * value, 0.0, 1e38, -1e-38, dice.uniform(-99, 99))
    )


def _change_rows(stream: Stream, dice: random.Random) -> None:
    values = stream.values
    if len(values) and dice.random() < 0.5:
        stream.values = np.delete(values, dice.randrange(len(values)), axis=0)
    elif len(values):
        place = dice.randrange(len(values))
        stream.values = np.insert(values, place, values[place], axis=0)


def _change_table(part: Part, stream: Stream, dice: random.Random) -> None:
    kind = dice.randrange(4)
    if kind == 0:
        part.streams.remove(stream)
    elif kind == 1:
        other = dice.choice([each for each in part.streams if each.name != "tail"])
        stream.values, other.values = other.values, stream.values
        stream.kind, other.kind = other.kind, stream.kind
        stream.width, other.width = other.width, stream.width
    elif kind == 2:
        stream.width = dice.choice((0, 1, 2, 3, 4, 65536))
    else:
        wanted = np.dtype(dice.choice(("u1", "i1", "<u2", "<i4", "<u4", "<i8", "<f4", "<f8", "?")))
        content = np.ascontiguousarray(stream.values).tobytes()
        content = content[: len(content) // wanted.itemsize * wanted.itemsize]
        stream.values = np.frombuffer(content, wanted)
        stream.kind = kind_of(wanted)


def _change_text(stream: Stream, dice: random.Random) -> None:
    try:
        data = json.loads(stream.values.tobytes())
    except ValueError:
        # Another change put something else here
        return
    change_text(data, dice)
    stream.values = np.frombuffer(json.dumps(data).encode(), np.uint8)
    stream.kind, stream.width = 0, 1


def change_text(data: object, dice: random.Random) -> None:
    """Change one value within lists and tables."""
    leaves: list[tuple[object, object]] = []
    _walk(data, leaves)
    if not leaves:
        return
    owner, key = dice.choice(leaves)
    old = owner[key]
    if dice.random() < 0.1:
        del owner[key]
    elif isinstance(old, list) and old and dice.random() < 0.5:
        old.append(copy.deepcopy(dice.choice(old)))
    elif isinstance(old, float) and dice.random() < 0.5:
        owner[key] = old * dice.choice((-1.0, 0.5, 2.0, 1e-3, 1e3, 1e-160, 1e160))
    else:
        numbers = (0, -1, 1, 2, 1.5, 1e308, -1e308, 2**31 - 1, 2**31, 2**63, 2**200, 65535, 65536)
        owner[key] = dice.choice((*numbers, None, "", "x", "sensor", [], {}, [old], True))


def _walk(data: object, leaves: list[tuple[object, object]]) -> None:
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        leaves.append((data, key))
        if isinstance(value, dict | list):
            _walk(value, leaves)


# -- what is done with a changed map ---------------------------------------------------------------


def exercise(path: Path, dice: random.Random) -> tuple[bool, dict[str, np.ndarray]]:
    """Read, ask and verify a map; (whether it was found sound, columns that were read)."""
    columns: dict[str, np.ndarray] = {}
    try:
        ray_map = raymap.open(path, on_damage="skip")
    except raymap.FormatError:
        return False, columns
    with ray_map:
        ray_map.describe()
        ask(ray_map, dice, path.parent)
        for number, stored in enumerate(ray_map.portions):
            for name in _FREE.values():
                with contextlib.suppress(KeyError, raymap.FormatError):
                    columns[f"{number}.{name}"] = stored.column(name)
        # Opens the file anew: what was found damaged by now does not count
        sound = not verify(ray_map).damage
    return sound, columns


def one_case(seed: Seed, dice: random.Random, path: Path) -> int:
    """Change a map and see what becomes of it; returns the number of changes.

    Raises
    ------
    AssertionError
        A promise of this module's head does not hold.
    """
    parts = [
        dataclasses.replace(part, streams=[dataclasses.replace(each) for each in part.streams])
        for part in seed.parts
    ]
    n = dice.choice((1, 1, 2, 4, 16, 32))
    changes = [change(parts, dice) for _ in range(n)]
    same = _equal(parts, seed.parts)
    path.write_bytes(put_together(parts))
    sound, columns = exercise(path, dice)
    if n > 1 or same:
        assert sound or not same, "an unchanged map is not sound"
        return n
    one = changes[0]
    told_twice = one.stream.split(".0")[0] in _STATED_TWICE or one.stream.startswith("path.sum")
    if told_twice and one.row >= 0 and not _nearly(parts, seed.parts, one):
        assert not sound, f"verify finds {one} sound"
    plain = not any(stream.name == "path_number" for stream in parts[one.part].streams)
    if one.tag == PORTION and one.stream in _FREE and one.row >= 0 and sound:
        number = [p.tag for p in parts[: one.part]].count(PORTION)
        [stream] = [s for s in parts[one.part].streams if s.name == one.stream]
        found = columns.get(f"{number}.{_FREE[one.stream]}")
        assert found is not None, one
        if plain or one.stream.startswith("x:"):
            assert found.tobytes() == stream.values.tobytes(), one
    return 1


def _nearly(a: list[Part], b: list[Part], one: Change) -> bool:
    """Whether sums were changed by no more than the order of their terms may change them."""
    [x], [y] = ([s for s in p[one.part].streams if s.name == one.stream] for p in (a, b))
    if x.values.dtype.kind != "f":
        return False
    return bool(np.allclose(x.values, y.values, rtol=1e-6, atol=1e-6))


def _equal(a: list[Part], b: list[Part]) -> bool:
    def same(x: Stream, y: Stream) -> bool:
        return (x.name, x.kind, x.width) == (y.name, y.kind, y.width) and (
            x.values.tobytes() == y.values.tobytes()
        )

    return all(
        p.meta == q.meta
        and len(p.streams) == len(q.streams)
        and all(same(x, y) for x, y in zip(p.streams, q.streams, strict=True))
        for p, q in zip(a, b, strict=True)
    )


if __name__ == "__main__":
    sys.exit(command_line(Path(__file__), seeds, one_case))
