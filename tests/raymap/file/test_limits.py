"""Whatever keeps to the limits of the format is written, opened, continued, repaired, verified."""

from __future__ import annotations

import dataclasses
import itertools
import operator
import struct
import tracemalloc

import numpy as np
import pytest
import xxhash
from hypothesis import HealthCheck, Phase, Verbosity, given, settings
from hypothesis import strategies as st

import raymap
from raymap.bytes.layout import DIRECTORY, pack_chunk_header, pack_file_header, parse_chunk_header
from raymap.bytes.streams import StreamSet
from raymap.file.reader import RayMap
from raymap.file.repair import repair
from raymap.file.verify import verify
from raymap.model import limits
from raymap.model.events import Event
from tests.examples import examples
from tests.raymap.compact import write_compactly
from tests.raymap.maps import RGB, small_directory, write_small
from tests.strategies import assert_same_portion, make_portion

_SLOW = settings(
    max_examples=examples(2),
    suppress_health_check=list(HealthCheck),
    # Directories of 32,767 names are not worth shrinking
    phases=[Phase.explicit, Phase.generate],
    print_blob=False,
    report_multiple_bugs=False,
    verbosity=Verbosity.quiet,
)
_COUNTS = st.sampled_from([0, 1, 342])
_KINDS = ("sources", "objects", "media", "surfaces", "detectors")
_numbers = st.floats(-(2.0**100), 2.0**100, width=32)


def _names(draw, count):
    """So many different names: short, as long as they may be, of any alphabet."""
    stem = draw(
        st.one_of(
            st.just(""),
            st.text(
                st.characters(exclude_categories=["Cc", "Cf", "Cs", "Zl", "Zp"]),
                min_size=1,
                max_size=40,
            ),
            st.just("\N{GRINNING FACE}" * (limits.MAX_NAME - 8 if count <= 342 else 1)),
        )
    )
    return [f"{stem}{k:08d}" if stem else str(k) for k in range(count)]


@st.composite
def _faces(draw, surfaces):
    """Faces of one object: none, some with shapes, or as many primitives as can be numbered."""
    if draw(st.booleans()):
        return ()
    faces, start = [], 0
    for number in range(draw(st.integers(1, 3))):
        count = draw(st.sampled_from([1, 2, 7]))
        quadric = raymap.Quadric(
            coefficients=tuple(draw(st.lists(_numbers, min_size=10, max_size=10))),
            solve_axis=draw(st.sampled_from([None, 0, 1, 2])),
        )
        faces.append(
            raymap.Face(
                name=f"face {number}",
                first_primitive=start,
                primitive_count=count,
                surface=draw(st.integers(-1, surfaces - 1)),
                aliases=draw(st.sampled_from([(), ("a.b", "")])),
                quadrics=draw(st.sampled_from([(), (quadric,) * count, (None,) * count])),
                parameters=draw(st.sampled_from([{}, {"roughness": 0.25}])),
            )
        )
        start += count
    if draw(st.booleans()):
        rest = limits.MAX_PRIMITIVES - start
        faces.append(raymap.Face(name="rest", first_primitive=start, primitive_count=rest))
    return tuple(faces)


@st.composite
def _directories(draw):
    most = draw(st.sampled_from(_KINDS))
    counts = {kind: limits.MAX_INDEX if kind == most else draw(_COUNTS) for kind in _KINDS}
    counts["sources"] = max(1, counts["sources"])
    surfaces = counts["surfaces"] = max(1, counts["surfaces"])
    kinds = [draw(_faces(surfaces)) for _ in range(3)]
    objects = [
        raymap.SceneObject.model_construct(
            name=name, kind="box" if k % 2 else "", faces=kinds[k % 3], parameters={}
        )
        for k, name in enumerate(_names(draw, counts["objects"]))
    ]
    return raymap.Directory(
        sources=tuple(raymap.Source(name=n) for n in _names(draw, counts["sources"])),
        objects=objects,
        media=tuple(raymap.Medium(name=n) for n in _names(draw, counts["media"])),
        surfaces=tuple(raymap.Surface(name=n) for n in _names(draw, surfaces)),
        detectors=tuple(
            raymap.Detector(name=n, cells=(65535 if k < 2 else 1, 2))
            for k, n in enumerate(_names(draw, counts["detectors"]))
        ),
        parameters=draw(st.sampled_from([{}, {"seed": 2**64, "bad": float("nan")}])),
        scene_hash="drawn",
    )


class _Quiet:
    """A directory that is not printed with its 32,767 names."""

    def __init__(self, directory):
        self.directory = directory


def _portion(directory, channels, first_ray):
    """Rays that meet the first and the last of everything."""
    portion = make_portion(directory, channels, n_rays=30, n_paths=3, seed=first_ray)
    n_objects, n_media = len(directory.objects), len(directory.media)
    change = {}
    if n_objects:
        item = portion.object.copy()
        item[item >= 0] = n_objects - 1
        triangle = np.where(item >= 0, -1, portion.triangle)
        if faces := directory.objects[-1].faces:
            last = faces[-1].first_primitive + faces[-1].primitive_count - 1
            triangle = np.where(item >= 0, last, -1)
        change = {"object": item, "triangle": triangle.astype(np.int32)}
    if n_media:
        change["medium"] = np.full(portion.n_records, n_media - 1, np.int16)
    source = np.full(portion.n_rays, len(directory.sources) - 1, np.int16)
    return dataclasses.replace(portion, source=source, first_ray=first_ray, **change)


@_SLOW
@given(drawn=_directories().map(_Quiet))
def test_directories_and_portions_up_to_the_limits_are_read_back(tmp_path_factory, drawn):
    directory = drawn.directory
    path = tmp_path_factory.mktemp("limits") / "a.raymap"
    portions = [_portion(directory, RGB, first) for first in (0, 100)]
    with raymap.RayMapWriter.create(path, directory) as writer:
        writer.add_channel_set(RGB)
        writer.start_run(seed=2**64 + 1, parameters={"nan": float("nan")})
        writer.append(portions[0])
    with raymap.RayMapWriter.append_to(path, directory) as writer:
        writer.append(portions[1])
    written = [path, path.with_name("b.raymap")]
    with raymap.open(path) as ray_map:
        assert verify(ray_map).damage == []
        assert repair(ray_map, written[1]) == 2
    for each in written:
        with raymap.open(each) as ray_map:
            found = ray_map.directory
            for name in ("sources", "media", "surfaces", "detectors", "objects"):
                same = getattr(found, name) == getattr(directory, name)
                assert same, name
            same = all(map(operator.eq, found.objects, directory.objects))
            assert same
            same = found.faces.names == directory.faces.names
            assert same
            assert ray_map.runs[0]["seed"] == 2**64 + 1
            for expected, stored in zip(portions, ray_map.portions, strict=True):
                assert_same_portion(expected, stored.read())


def _one_ray(directory, *, descriptors):
    """A ray of one segment that meets detectors so often."""
    event = [int(Event.EMITTED), int(Event.LEFT_SCENE)]
    return raymap.Portion(
        emitted=np.ones(len(directory.sources), np.int64),
        source=np.zeros(1, np.int16),
        records_per_ray=np.array([2], np.int32),
        position=np.zeros((2, 3), np.float32),
        normal=np.zeros((2, 3), np.int16),
        object=np.full(2, -1, np.int16),
        triangle=np.full(2, -1, np.int32),
        event=np.array(event, np.int32),
        medium=np.full(2, -1, np.int16),
        color_code=np.zeros(2, np.int32),
        color_table=np.empty((0, 3), np.uint16),
        descriptor_count=np.array([descriptors, 0], np.uint16),
        descriptors=raymap.Descriptors(
            detector=np.arange(descriptors).astype(np.int16) % len(directory.detectors),
            cell=np.zeros((descriptors, 2), np.uint16),
            cosine=np.full(descriptors, -32767, np.int16),
            uv=np.full((descriptors, 2), 65535, np.uint16),
            registered=np.arange(descriptors) % 2 == 0,
        ),
    )


@pytest.mark.parametrize("compact", [False, True])
def test_a_segment_may_meet_65535_detectors(tmp_path, compact):
    directory = small_directory()
    portion = _one_ray(directory, descriptors=limits.MAX_DESCRIPTORS_PER_SEGMENT)
    with raymap.RayMapWriter.create(tmp_path / "a.raymap", directory) as writer:
        if compact:
            write_compactly(writer)
        writer.add_channel_set(RGB)
        writer.append(portion)
    with raymap.open(tmp_path / "a.raymap") as ray_map:
        assert verify(ray_map).damage == []
        assert_same_portion(portion, ray_map.portions[0].read())


def test_streams_that_expand_too_far_are_stored_as_they_are(tmp_path):
    """128 constant columns of 2²³ bytes: together as much as a chunk may expand to, and more."""
    streams = StreamSet()
    zeros = np.zeros(2**23, np.uint8)
    for k in range(129):
        streams.add(f"x:{k}", zeros)
    streams.add("x:long", np.zeros(2**27 + 1, np.uint8))
    assert all(limits.may_expand(e.raw_size, e.stored_size) for e in streams.entries)
    buffers = streams.chunk(DIRECTORY)
    header = parse_chunk_header(bytes(buffers[0]))
    sizes = [(entry.raw_size, entry.stored_size) for entry in header.streams]
    assert limits.surplus(sizes, header.size) == 0
    assert header.size < 2**28 + 2**24


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"extra": {"a": np.zeros((50, 0))}}, "no elements"),
        ({"extra": {"a": np.zeros((50, 2, 2))}}, "shape"),
        ({"extra": {"a": np.zeros(50, np.float16)}}, "float16"),
        ({"first_ray": limits.MAX_RAY - 50}, "ray numbers stay below"),
        ({"emitted": np.array([0, limits.MAX_RAY])}, "emitted counts stay below"),
        ({"extra": {f"a{k}": np.zeros(50) for k in range(66_000)}}, "streams"),
    ],
)
def test_portions_beyond_the_limits_are_refused_and_nothing_is_lost(tmp_path, change, words):
    path = tmp_path / "a.raymap"
    directory = small_directory()
    portion = make_portion(directory, RGB, n_rays=50)
    with raymap.RayMapWriter.create(path, directory) as writer:
        writer.add_channel_set(RGB)
        writer.append(dataclasses.replace(portion, first_ray=0))
        with pytest.raises((raymap.LimitExceeded, raymap.InvalidPortion), match=words):
            writer.append(dataclasses.replace(portion, **{"first_ray": 1000, **change}))
    with raymap.open(path) as ray_map:
        assert ray_map.finished
        assert ray_map.rays == 50


def _nested(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


@pytest.mark.parametrize("parameters", [{"deep": _nested(100_000)}, {"what": object()}])
def test_directories_and_runs_that_cannot_be_read_again_are_refused(tmp_path, parameters):
    path = tmp_path / "a.raymap"
    directory = small_directory().model_copy(update={"parameters": parameters})
    with pytest.raises(raymap.LimitExceeded, match="cannot be written as JSON"):
        raymap.RayMapWriter.create(path, directory)
    assert not path.exists()
    with raymap.RayMapWriter.create(path, small_directory()) as writer:
        with pytest.raises(raymap.LimitExceeded, match="cannot be written as JSON"):
            writer.start_run(parameters=parameters)
        writer.add_channel_set(RGB)
    with raymap.open(path) as ray_map:
        assert ray_map.finished


@pytest.mark.parametrize("name", ["", "x" * (limits.MAX_NAME + 1)])
@pytest.mark.parametrize("what", ["object", "face", "detector"])
def test_names_that_were_changed_unchecked_are_refused_before_they_are_written(
    tmp_path, name, what
):
    path = tmp_path / "a.raymap"
    directory = small_directory()
    changed = {"name": name}
    first = directory.objects[0]
    if what == "face":
        changed = {"faces": (first.faces[0].model_copy(update=changed), *first.faces[1:])}
    update = {"objects": [first.model_copy(update=changed), *directory.objects[1:]]}
    if what == "detector":
        update = {"detectors": (directory.detectors[0].model_copy(update=changed),)}
    with pytest.raises((raymap.LimitExceeded, ValueError), match=r"name"):
        raymap.RayMapWriter.create(path, small_directory(**update))
    assert not path.exists()


def test_too_many_of_a_kind_and_too_many_primitives_are_refused():
    many = [raymap.SceneObject(name=str(k)) for k in range(limits.MAX_INDEX + 1)]
    with pytest.raises(ValueError, match="at most 32767"):
        raymap.Directory(sources=(), objects=many)
    faces = tuple(
        raymap.Face(name=str(k), first_primitive=k * 2**30, primitive_count=2**30) for k in (0, 1)
    )
    with pytest.raises(ValueError, match="at most 2147483647"):
        raymap.SceneObject(name="mesh", faces=faces)
    for name in ("", "x" * (limits.MAX_NAME + 1)):
        with pytest.raises(ValueError, match="name"):
            raymap.SceneObject(name=name)


def test_channel_sets_beyond_the_limit_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("raymap.file.writer.MAX_CHANNEL_SETS", 2)
    with raymap.RayMapWriter.create(tmp_path / "a.raymap", small_directory()) as writer:
        writer.add_channel_set(RGB)
        writer.add_channel_set(RGB, again=True)
        with pytest.raises(raymap.LimitExceeded, match="write a new map"):
            writer.add_channel_set(RGB, again=True)


def _map_of_version_1(path, n_objects):
    """A map as version 1 wrote it: JSON for all objects, three columns per display mesh."""
    directory = raymap.Directory(
        sources=(raymap.Source(name="lamp"),),
        objects=[raymap.SceneObject(name=f"disc{k}", kind="disc") for k in range(n_objects)],
    )
    streams = StreamSet()
    streams.add_bytes("json", directory.model_dump_json(exclude_defaults=True).encode())
    for k in range(n_objects):
        for name, column in (
            ("vertices", np.full((3, 3), k, np.float32)),
            ("triangles", np.array([[0, 1, 2]], np.int32)),
            ("face", np.zeros(1, np.int32)),
        ):
            # As it was written: every column in planes
            planes = column.reshape(-1, 1).view(np.uint8).T.copy()
            streams.add_planes(f"mesh.{k}.{name}", column.dtype, planes, 0)
            width = column.shape[1] if column.ndim > 1 else 1
            for row in range(-column.itemsize, 0):
                streams.entries[row] = dataclasses.replace(streams.entries[row], width=width)
    header = pack_chunk_header(DIRECTORY, b"", streams.entries)
    first = pack_file_header()[:12] + struct.pack("<HH", 1, 0)
    path.write_bytes(b"".join([first, header, *map(bytes, streams.buffers)]))
    with raymap.RayMapWriter.append_to(path) as writer:
        writer.add_channel_set(RGB)
        writer.append(make_portion(directory, RGB, n_rays=20))
    return directory


def test_maps_of_more_streams_than_their_readers_took_are_opened_and_repaired(tmp_path):
    path = tmp_path / "old.raymap"
    directory = _map_of_version_1(path, 400)
    assert path.read_bytes()[12:16] == struct.pack("<HH", 1, 0)
    with raymap.open(path) as old:
        assert len(old.file.chunk_at(16, old.bytes).header.streams) == 1 + 12 * 400
        assert old.directory == directory
        assert verify(old).damage == []
        assert repair(old, tmp_path / "new.raymap") == 1
        with raymap.open(tmp_path / "new.raymap") as new:
            assert new.directory == directory
            assert list(new.meshes) == list(range(400))
            for k, mesh in new.meshes.items():
                assert mesh.vertices.tolist() == [[k] * 3] * 3
                assert mesh.triangles.tolist() == old.meshes[k].triangles.tolist()
            assert_same_portion(old.portions[0].read(), new.portions[0].read())
            assert len(new.file.chunk_at(16, new.bytes).header.streams) < 30
            assert new.bytes < old.bytes / 10


def test_a_map_of_version_1_is_continued_in_its_version(tmp_path):
    path = tmp_path / "old.raymap"
    directory = _map_of_version_1(path, 3)
    with raymap.RayMapWriter.append_to(path, directory) as writer:
        writer.append(make_portion(directory, RGB, n_rays=10, seed=1))
    with raymap.open(path) as ray_map:
        assert ray_map.file.major == 1
        assert ray_map.rays == 30
        assert ray_map.merged.paths.rays.sum() == 30
        assert verify(ray_map).damage == []


def test_ten_thousand_boxes_cost_a_megabyte(tmp_path):
    """Places and sizes of 10,000 boxes take 480 kB as numbers; all the rest is small."""
    rng = np.random.default_rng(5)
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    objects, meshes = [], {}
    for k in range(10_000):
        center, size = rng.uniform(-500, 500, 3).round(2), rng.uniform(1, 5, 3).round(2)
        faces = []
        for number, (axis, sign) in enumerate(itertools.product(range(3), (1.0, -1.0))):
            c = np.zeros(10)
            c[6 + axis], c[9] = sign, -(sign * center[axis] + size[axis] / 2)
            quadric = raymap.Quadric.model_construct(coefficients=tuple(c), solve_axis=axis)
            faces.append(
                raymap.Face.model_construct(
                    name=f"{'xyz'[axis]}{sign:+}",
                    first_primitive=number,
                    primitive_count=1,
                    surface=0,
                    quadrics=(quadric,),
                )
            )
        given = {"position": center.tolist(), "size": size.tolist()}
        objects.append(
            raymap.SceneObject.model_construct(
                name=f"box{k}", kind="box", faces=tuple(faces), parameters=given
            )
        )
        meshes[k] = raymap.DisplayMesh(
            vertices=(center + corners * size).astype(np.float32),
            triangles=np.array([[0, 1, 2], [1, 2, 3]], np.int32),
            face=np.zeros(2, np.int32),
        )
    directory = raymap.Directory(
        sources=(raymap.Source(name="lamp"),),
        surfaces=(raymap.Surface(name="white"),),
        objects=objects,
    )
    path = tmp_path / "boxes.raymap"
    with raymap.RayMapWriter.create(path, directory, meshes=meshes):
        pass
    assert path.stat().st_size < 3e6
    with raymap.open(path) as ray_map:
        found = ray_map.directory
        # Nothing was made of an object that nobody asked for
        assert not any(vars(found.objects)["_made"])
        assert found.object_columns.names[-1] == "box9999"
        assert found.objects[7] == objects[7]
        assert len(ray_map.shapes.face_code) == 60_000
        np.testing.assert_array_equal(ray_map.meshes[9999].vertices, meshes[9999].vertices)


def test_damaged_columns_of_objects_are_refused(tmp_path):
    """Every byte of the directory: refused, or what it says is the same."""
    write_small(tmp_path / "a.raymap", n_portions=1)
    data = bytearray((tmp_path / "a.raymap").read_bytes())
    (size,) = struct.unpack_from("<Q", data, 32)
    header = parse_chunk_header(bytes(data[16 : 16 + size]))
    with RayMap(tmp_path / "a.raymap") as ray_map:
        before = ray_map.directory
    for entry in header.streams:
        for place in range(entry.stored_size):
            changed = bytearray(data)
            changed[16 + entry.offset + place] ^= 0x41
            stored = bytes(changed[16 + entry.offset :][: entry.stored_size])
            _assert_refused_or_equal(tmp_path, changed, header, entry, stored, before)


def _assert_refused_or_equal(folder, data, header, entry, stored, before):
    """Make the checksums right again, as an attacker would; opening ends in one error, or well."""
    entries = [
        dataclasses.replace(each, hash=xxhash.xxh3_64_intdigest(stored)) if each is entry else each
        for each in header.streams
    ]
    packed = pack_chunk_header(DIRECTORY, header.meta, entries)
    path = folder / "b.raymap"
    path.write_bytes(bytes(data[:16]) + packed + bytes(data[16 + len(packed) :]))
    try:
        with RayMap(path) as ray_map:
            list(ray_map.directory.objects)
            assert len(ray_map.directory.objects) == len(before.objects)
    except raymap.FormatError:
        pass


def test_a_number_of_primitives_costs_nothing(tmp_path):
    """A face of 2³¹ − 1 primitives without quadrics is four bytes: nothing is allocated."""
    sphere = raymap.Quadric(coefficients=(1, 1, 1, 0, 0, 0, 0, 0, 0, -2500.0), solve_axis=2)
    several = raymap.Face(name="rim", primitive_count=2, quadrics=(sphere, None))
    whole = small_directory()

    def cost(claimed: int, target) -> int:
        claim = raymap.Face(name="claim", primitive_count=claimed)
        more = (
            raymap.SceneObject(name="two", faces=(several,)),
            raymap.SceneObject(name="mesh", faces=(claim,)),
        )
        write_small(target, directory=small_directory(objects=(*whole.objects, *more)))
        tracemalloc.start()
        with raymap.open(target) as ray_map:
            for portion in ray_map.portions:
                for name in ("triangle", "position", "normal"):
                    portion.column(name)
            assert not verify(ray_map).damage
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    honest = cost(9, tmp_path / "honest.raymap")
    assert cost(2**31 - 1, tmp_path / "claims.raymap") < honest + 2**22
