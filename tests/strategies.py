"""Hypothesis strategies of directories and portions: whatever a tracer could hand to the writer.

`directories()` draws a small scene, `portions(directory, channels)` rays in it. Points lie on the
quadrics of their faces as often as not, so that both sides of every encoding are met.
"""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

import raymap
from raymap.model.events import ENDINGS, Event

__all__ = ["channel_sets", "directories", "make_portion", "portions"]

_ENDING_BITS = [1 << bit for bit in range(32) if int(ENDINGS) >> bit & 1]
_MIDDLE_BITS = [
    1 << bit
    for bit in range(31)
    if not int(ENDINGS) >> bit & 1 and 1 << bit not in (int(Event.EMITTED),)
]

_numbers = st.floats(-100, 100, allow_nan=False).map(lambda value: float(np.float32(value)))


@st.composite
def _quadrics(draw):
    kind = draw(st.sampled_from(["sphere", "plane", "any", "none"]))
    axis = draw(st.sampled_from([None, 0, 1, 2]))
    if kind == "none":
        return None
    if kind == "plane":
        normal = [draw(_numbers) for _ in range(3)]
        return raymap.Quadric(coefficients=(0.0,) * 6 + (*normal, draw(_numbers)), solve_axis=axis)
    if kind == "sphere":
        x, y, z = (draw(_numbers) for _ in range(3))
        r = draw(st.floats(0.1, 100))
        return raymap.Quadric(
            coefficients=(1, 1, 1, 0, 0, 0, -2 * x, -2 * y, -2 * z, x * x + y * y + z * z - r * r),
            solve_axis=axis,
        )
    coefficients = tuple(draw(st.lists(_numbers, min_size=10, max_size=10)))
    return raymap.Quadric(coefficients=coefficients, solve_axis=axis)


@st.composite
def directories(draw):
    """A scene of up to four objects with up to three faces each, some of several primitives."""
    media = draw(st.integers(0, 3))
    objects = []
    for number in range(draw(st.integers(0, 4))):
        faces = []
        start = 0
        for face in range(draw(st.integers(0, 3))):
            count = draw(st.sampled_from([1, 1, 1, 5]))
            with_shape = draw(st.booleans())
            quadrics = tuple(draw(_quadrics()) for _ in range(count)) if with_shape else ()
            faces.append(
                raymap.Face(
                    name=f"face{face}",
                    first_primitive=start,
                    primitive_count=count,
                    quadrics=quadrics,
                )
            )
            start += count
        objects.append(raymap.SceneObject(name=f"object{number}", faces=tuple(faces)))
    detectors = [
        raymap.Detector(
            name=f"detector{number}",
            kind=draw(st.sampled_from(["plane", "far_field"])),
            cells=(draw(st.integers(1, 65535)), draw(st.integers(1, 9))),
            center=(draw(_numbers), draw(_numbers), draw(_numbers)),
            size=(draw(st.floats(0.1, 50)), 10.0),
            uv_meaning=draw(st.sampled_from(["crossing", "projection"])),
        )
        for number in range(draw(st.integers(0, 3)))
    ]
    return raymap.Directory(
        sources=tuple(
            raymap.Source(name=f"source{number}", flux=number + 0.5)
            for number in range(draw(st.integers(1, 3)))
        ),
        objects=tuple(objects),
        media=tuple(raymap.Medium(name=f"medium{number}") for number in range(media)),
        detectors=tuple(detectors),
        bounding_sphere=raymap.BoundingSphere(center=(1.0, 2.0, 3.0), radius=50.0),
        scene_hash="drawn",
    )


@st.composite
def channel_sets(draw):
    """RGB, or up to five wavelengths."""
    if draw(st.booleans()):
        return raymap.ChannelSet(kind="rgb", wavelengths_nm=(610.0, 550.0, 465.0))
    n = draw(st.integers(1, 5))
    return raymap.ChannelSet(
        kind="spectral", wavelengths_nm=tuple(450.0 + 10 * k for k in range(n))
    )


@st.composite
def portions(draw, directory, channel_set, max_rays=60, channel_set_index=0):
    """A portion of rays in the scene; drawn numbers choose its character, a seed fills it."""
    return make_portion(
        directory,
        channel_set,
        n_rays=draw(st.integers(0, max_rays)),
        seed=draw(st.integers(0, 2**32 - 1)),
        n_paths=draw(st.sampled_from([1, 3, None])),
        weighted=draw(st.booleans()),
        grouped=draw(st.booleans()),
        with_ids=draw(st.booleans()),
        extra=draw(st.booleans()),
        strange=draw(st.booleans()),
        channel_set_index=channel_set_index,
    )


def make_portion(
    directory,
    channel_set,
    *,
    n_rays,
    seed=0,
    n_paths=3,
    weighted=False,
    grouped=False,
    with_ids=False,
    extra=False,
    strange=False,
    channel_set_index=0,
):
    """A random portion.

    Parameters
    ----------
    n_paths : rays take one of so many itineraries; None: each its own
    strange : positions of any magnitude, normals of any value
    """
    rng = np.random.default_rng(seed)
    itineraries = [
        _itinerary(directory, rng) for _ in range(n_rays if n_paths is None else n_paths)
    ]
    if n_paths is None:
        taken = np.arange(n_rays)
    else:
        taken = np.minimum(rng.geometric(0.5, n_rays) - 1, n_paths - 1)
    rays = [itineraries[path] for path in taken]
    points = [point for _, ray in rays for point in ray]
    n = len(points)
    descriptor_count = np.array([len(point[5]) for point in points], np.uint16)
    crossings = [crossing for point in points for crossing in point[5]]
    k = len(crossings)
    position = _positions(directory, points, strange, rng)
    cells = np.array([d.cells for d in directory.detectors], np.int64).reshape(-1, 2)
    detector = np.array([crossing[0] for crossing in crossings], np.int16)
    channels = channel_set.n_channels
    table = _colors(rng, channels)
    codes = rng.integers(0, channels + len(table), n).astype(np.int32)
    if rng.random() < 0.7:
        # Keep the colour along most of each ray
        starts = np.cumsum([0] + [len(ray) for _, ray in rays[:-1]]) if rays else []
        for start, (_, ray) in zip(starts, rays, strict=True):
            codes[start + min(1, len(ray) - 1) : start + len(ray)] = codes[start]
    scale = 1 if directory.faces.names else 3
    return raymap.Portion(
        emitted=rng.integers(n_rays, n_rays + 10, len(directory.sources)),
        source=np.array([source for source, _ in rays], np.int16),
        records_per_ray=np.array([len(ray) for _, ray in rays], np.int32),
        position=position,
        normal=rng.integers(-32768 if strange else -9, 32768 if strange else 9, (n, 3)).astype(
            np.int16
        )
        * np.int16(rng.integers(0, 2) * scale),
        object=np.array([point[0] for point in points], np.int16),
        triangle=np.array([point[1] for point in points], np.int32),
        event=np.array([point[3] for point in points], np.int32),
        medium=np.array([point[4] for point in points], np.int16),
        color_code=codes,
        color_table=table,
        descriptor_count=descriptor_count,
        descriptors=raymap.Descriptors(
            detector=detector,
            cell=(rng.random((k, 2)) * cells[detector]).astype(np.uint16).reshape(k, 2),
            cosine=rng.integers(-32768, 32768, k).astype(np.int16),
            uv=rng.integers(0, 65536, (k, 2)).astype(np.uint16),
            registered=np.array([crossing[1] for crossing in crossings], np.bool_),
        ),
        first_ray=int(rng.integers(0, 1000)),
        ray_ids=1000 + np.cumsum(rng.integers(1, 5, n_rays)) if with_ids else None,
        channel_set=channel_set_index,
        weight=rng.random(n_rays).astype(np.float32) if weighted else None,
        emission=rng.integers(0, max(1, n_rays // 2) + 1, n_rays) if grouped else None,
        extra={"phase": rng.random(n), "lobe": rng.integers(0, 9, (n_rays, 2))} if extra else {},
    )


def _itinerary(directory, rng):
    """(source, points); a point is (object, triangle, face, event, medium, crossings)."""
    n = int(rng.integers(1, 7))
    points = []
    for step in range(n):
        item = int(rng.integers(-1, len(directory.objects)))
        triangle = -1
        if item >= 0 and (faces := directory.objects[item].faces):
            last = faces[-1]
            triangle = int(rng.integers(0, last.first_primitive + last.primitive_count))
        elif item >= 0:
            triangle = int(rng.integers(-1, 100))
        event = int(rng.choice(_MIDDLE_BITS)) if step else int(Event.EMITTED)
        if step == n - 1:
            event |= int(rng.choice(_ENDING_BITS))
        medium = int(rng.integers(-1, len(directory.media)))
        crossings = []
        if step < n - 1 and directory.detectors:
            crossings = [
                (int(rng.integers(0, len(directory.detectors))), bool(rng.integers(0, 2)))
                for _ in range(rng.integers(0, 3))
            ]
        points.append((item, triangle, None, event, medium, crossings))
    return int(rng.integers(0, len(directory.sources))), points


def _colors(rng, channels):
    shares = rng.integers(0, 65536 // channels, (rng.integers(0, 4), channels))
    shares[:, -1] = 65535 - shares[:, :-1].sum(axis=1)
    return shares.astype(np.uint16)


def _positions(directory, points, strange, rng):
    n = len(points)
    position = rng.uniform(-60, 60, (n, 3)).astype(np.float32)
    if strange:
        position = (position * 10.0 ** rng.uniform(-40, 36, (n, 3))).astype(np.float32)
        position[rng.random((n, 3)) < 0.1] = 0.0
        position[rng.random((n, 3)) < 0.1] = -0.0
    # Put points on their quadrics as well as that goes
    for row, (item, triangle, *_) in enumerate(points):
        if item < 0 or triangle < 0 or rng.random() < 0.3:
            continue
        for face in directory.objects[item].faces:
            place = triangle - face.first_primitive
            if 0 <= place < len(face.quadrics) and face.quadrics[place] is not None:
                _move_onto(position[row], face.quadrics[place])
    return position


def _move_onto(p, quadric):
    c = quadric.coefficients
    x, y = (float(value) for value in p[:2])
    a, b = c[2], c[4] * x + c[5] * y + c[8]
    rest = c[0] * x * x + c[1] * y * y + c[3] * x * y + c[6] * x + c[7] * y + c[9]
    roots = np.roots([a, b, rest]) if a or b else []
    real = [root.real for root in roots if abs(root.imag) < 1e-9 and abs(root) < 1e30]
    if real:
        p[2] = real[0]


def assert_same_portion(expected, found):
    """All columns equal bit for bit, ray numbers included."""
    n = expected.n_rays
    for name in (
        "emitted",
        "source",
        "records_per_ray",
        "position",
        "normal",
        "object",
        "triangle",
        "event",
        "medium",
        "color_code",
        "color_table",
        "descriptor_count",
        "weight",
        "emission",
    ):
        _assert_same(name, getattr(expected, name), getattr(found, name))
    for name in ("detector", "cell", "cosine", "uv", "registered"):
        _assert_same(name, getattr(expected.descriptors, name), getattr(found.descriptors, name))
    assert list(expected.extra) == list(found.extra)
    for name, column in expected.extra.items():
        _assert_same(name, column, found.extra[name])
    if n:
        _assert_same("ray ids", _ids(expected), _ids(found))


def _ids(portion):
    if portion.ray_ids is not None:
        return portion.ray_ids
    return np.arange(portion.first_ray, portion.first_ray + portion.n_rays)


def _assert_same(name, expected, found):
    if expected is None or found is None:
        assert expected is None, name
        assert found is None, name
        return
    assert expected.dtype == found.dtype, name
    assert expected.shape == found.shape, name
    assert expected.tobytes() == found.tobytes(), name
