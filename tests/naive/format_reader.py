"""A reader of ray maps written from docs/format.md alone: slow, plain, independent."""

import json
import struct

import numpy as np
import xxhash
import zstandard

KINDS = ["u1", "i1", "<u2", "<i2", "<u4", "<i4", "<u8", "<i8", "<f4", "<f8", "?", "<c8", "<c16"]


@np.errstate(all="ignore")
def read_map(path):
    """(directory, channel sets, portions); a portion is a dict of columns."""
    with open(path, "rb") as file:
        data = file.read()
    assert data[:12] == b"\x89RAYMAP\r\n\x1a\n\0"
    assert data[12] in (1, 2)  # the major version
    directory, channels, portions, offset = {}, [], [], 16
    while offset < len(data):
        tag, meta, streams, offset = read_chunk(data, offset)
        if tag == b"RMAP:DIR":
            directory = text(streams, "json")
            if data[12] == 2:
                directory["objects"] = objects(streams)
        elif tag == b"RMAP:CHN":
            channels.append(text(streams, "json"))
        elif tag == b"RMAP:POR":
            portions.append(read_portion(directory, channels, meta, streams))
    return directory, channels, portions


def read_chunk(data, start):
    tag, _, n_streams, meta_size, size, checksum = struct.unpack_from("<8sHHIQQ", data, start)
    table, offset = start + 32 + meta_size, start + 32 + meta_size + 64 * n_streams
    head = data[start : start + 24] + data[start + 32 : offset]
    assert xxhash.xxh3_64_intdigest(head) == checksum
    columns = Columns()
    for row in struct.iter_unpack("<32sBBBBIQQQ", data[table:offset]):
        name, kind, codec, plane, _, width, raw, stored, digest = row
        content = data[offset : offset + stored]
        offset += stored
        assert xxhash.xxh3_64_intdigest(content) == digest
        content = zstandard.decompress(content, raw) if codec == 1 else content
        content = np.frombuffer(content * raw if codec == 2 else content, np.uint8)
        size_of = np.dtype(KINDS[kind]).itemsize
        step, n = (1, raw // size_of) if plane == 255 else (size_of, raw)
        shape_of = (n // width, width) if width > 1 else n
        column = columns.setdefault(name.rstrip(b"\0").decode(), np.empty(shape_of, KINDS[kind]))
        column.reshape(-1).view(np.uint8)[plane % 255 :: step] = content
    assert offset == start + size
    return tag, data[start + 32 : table], columns, offset


class Columns(dict):
    """Columns by name; one that is not there has no rows."""

    def __missing__(self, name):
        return np.empty(0, "u1")


def text(streams, name):
    return json.loads(streams[name].tobytes()) if name in streams else []


def objects(streams):
    """The columns of version 2 as the list of objects of version 1."""
    names, kinds = text(streams, "face.names"), ("face.name", "face.surface", "face.primitives")
    axes, quadrics = iter(streams["shape.axis"]), iter(streams["shape.quadric"])
    faces, every, first = [], [], 0
    for row, shapes in enumerate(streams["face.shapes"]):
        number, surface, count = (int(streams[kind][row]) for kind in kinds)
        face = {"name": names[number], "surface": surface, "primitive_count": count}
        taken = [int(next(axes)) for _ in range(shapes)]
        face["quadrics"] = [
            None
            if a == -2
            else {"coefficients": next(quadrics), "solve_axis": None if a < 0 else a}
            for a in taken
        ]
        faces.append(face)
    for row, further in text(streams, "face.further"):
        faces[row] |= further
    for name, count in zip(text(streams, "object.names"), streams["object.faces"], strict=True):
        own, first = faces[first : first + count], first + int(count)
        ends = np.cumsum([face["primitive_count"] for face in own])
        for face, end in zip(own, ends, strict=True):
            face["first_primitive"] = int(end) - face["primitive_count"]
        every.append({"name": name, "faces": own})
    for row, further in text(streams, "object.further"):
        every[row] |= further
    return every


def zigzag(column):
    column = np.asarray(column, np.int64)
    return (column >> 1) ^ -(column & 1)


def read_portion(directory, channels, meta, streams):
    head = struct.unpack_from("<QqqIIQIIQHHI", meta)
    first_ray, n, n_records, channel_set, flags = (head[k] for k in (1, 3, 4, 9, 10))
    out = {"emitted": np.frombuffer(meta[64:], "<i8")}
    gaps = streams["ray_gap"].astype(np.int64) if flags & 2 else np.arange(n) > 0
    out["ray_ids"] = first_ray + np.cumsum(gaps)
    # Give every record the row of its path's point, every descriptor that of its crossing
    number = streams["path_number"] if flags & 1 else np.arange(n)
    length = streams["path.length"].astype(np.int64)
    rows = spread(length, number)
    crossings = streams["path.meetings"].astype(np.int64)
    meet = spread(crossings, rows)
    out |= {"source": streams["path.source"][number], "records_per_ray": length[number]}
    out["descriptor_count"] = crossings[rows]
    for name in ("object", "face", "event", "medium", "detector", "registered"):
        out[name] = streams[f"path.{name}"][meet if name[-2:] in ("or", "ed") else rows]
    faces = [f for o in directory.get("objects", []) for f in o.get("faces", [])]
    explicit, out["triangle"] = iter(streams["triangle"]), np.full(n_records, -1)
    for i, f in enumerate(out["face"]):
        if out["object"][i] >= 0:
            several = f < 0 or faces[f].get("primitive_count", 1) > 1
            start = faces[f].get("first_primitive", 0) if f >= 0 else 0
            out["triangle"][i] = start + (next(explicit) if several else 0)
    first = np.cumsum(length[number]) - length[number]
    shapes = [shape(faces, out, i, i in first) for i in range(n_records)]
    out["position"] = positions(directory, shapes, flags, streams)
    out["normal"] = normals(faces, shapes, flags, streams, out)
    out.update(descriptors(directory, flags, streams, out))
    out["color"] = colors(len(channels[channel_set]["wavelengths_nm"]), streams, out)
    others = ("weight", "emission", *(name for name in streams if name.startswith("x:")))
    return out | {name: streams[name] for name in others if name in streams}


def spread(counts, taken):
    """Rows of the taken runs, runs of the given lengths standing one after the other."""
    runs = [np.arange(end - n, end) for n, end in zip(counts, np.cumsum(counts), strict=True)]
    return np.concatenate([np.empty(0, np.int64), *(runs[k] for k in taken)])


def shape(faces, out, i, first):
    """(primitive, coefficients, axis) on a quadric, (primitive,) to be remembered, or a word."""
    number = out["face"][i]
    if number < 0:
        left = out["object"][i] < 0 and out["event"][i] >> 10 & 1
        return "emission" if first else "left" if left else "none"
    face = faces[number]
    place = int(out["triangle"][i]) - face.get("first_primitive", 0)
    quadric = face["quadrics"][place] if face.get("quadrics") else None
    if quadric:
        return (number, place), quadric["coefficients"], quadric.get("solve_axis")
    return ((number, place),) if face.get("primitive_count", 1) > 1 else "none"


def positions(directory, shapes, flags, streams):
    sphere = directory.get("bounding_sphere", {})
    x, y, z = sphere.get("center", (0.0, 0.0, 0.0))
    constant = ((x * x + y * y) + z * z) - sphere.get("radius", 1.0) ** 2
    ball = ("sphere", (1.0, 1.0, 1.0, 0, 0, 0, -2 * x, -2 * y, -2 * z, constant), 2)
    stored = [iter(streams[f"position.{axis}"]) for axis in "xyz"]
    residual = iter(zigzag(streams["position.residual"]))
    roots, last = iter(streams["position.root"]), {}
    out = np.empty((len(shapes), 3), np.float32)
    for i, kind in enumerate(shapes):
        key, q, axis = None, None, None
        if (flags & 32 and kind == "left") or (flags & 16 and len(kind) == 3):
            key, q, axis = ball if kind == "left" else kind
        for k in range(3):
            if k != axis:
                out[i, k] = next(stored[k])
        if axis is not None:
            last[key] = last.get(key, 0) ^ int(next(roots))
            bits = int(root(q, axis, out[i], last[key]).view(np.int32))
            here = (bits ^ (bits >> 31 & 0x7FFFFFFF)) + int(next(residual))
            here = (here + 2**31) % 2**32 - 2**31
            out[i, axis] = np.int32(here ^ (here >> 31 & 0x7FFFFFFF)).view(np.float32)
    return out


def root(q, a, p, second):
    b, c = (k for k in range(3) if k != a)
    u, v, q = np.float64(p[b]), np.float64(p[c]), np.array(q, float)
    big = (q[2 + a + b] * u + q[2 + a + c] * v) + q[6 + a]
    linear = (q[6 + b] * u + q[6 + c] * v) + q[9]
    rest = ((q[b] * u * u + q[c] * v * v) + q[2 + b + c] * u * v) + linear
    d = big * big - (4.0 * q[a]) * rest
    w = np.sqrt(d) if d > 0 else 0.0
    s = -0.5 * (big + (w if big >= 0 else -w))
    t = -rest / big if q[a] == 0 else (rest / s if second else s / q[a])
    return np.array(t if -3.4e38 <= t <= 3.4e38 else 0.0).astype(np.float32)


def dot(a, b):
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def scaled(g):
    s = dot(g, g)
    return np.floor(np.array(g) * (32767 / np.sqrt(s)) + 0.5) if 0 < s < 1e300 else np.zeros(3)


def normals(faces, shapes, flags, streams, out):
    stored = np.stack([streams[f"normal.{axis}"] for axis in "xyz"], 1)
    if not flags & 64:
        return stored
    many = sum(face.get("primitive_count", 1) for face in faces) > 2**22
    source, last = np.repeat(out["source"], out["records_per_ray"]), {}
    position, result = out["position"].astype(float), np.empty((len(shapes), 3), np.int16)
    for i, kind in enumerate(shapes):
        x, y, z = position[i]
        key, guess = None, np.zeros(3)
        if len(kind) == 3:
            xx, yy, zz, xy, xz, yz, cx, cy, cz, _ = kind[1]
            gx = ((2 * xx) * x + xy * y) + (xz * z + cx)
            gy = ((2 * yy) * y + xy * x) + (yz * z + cy)
            guess = scaled((gx, gy, ((2 * zz) * z + xz * x) + (yz * y + cz)))
        elif kind == "left":
            guess = scaled(position[i] - position[i - 1])
        elif kind == "emission" or (kind != "none" and not many):
            key = int(source[i]) if kind == "emission" else kind
            guess = last.get(key, guess)
        result[i] = (guess.astype(np.int64) + zigzag(stored[i])).astype(np.int16)
        last[key] = result[i]
    return result


def rounded(x, low, high):
    return low if x < low else 0 if x != x else high if x > high else int(np.floor(x + 0.5))


def descriptors(directory, flags, streams, out):
    names, n = ("cell_u", "cell_v", "cosine", "u", "v"), len(out["detector"])
    stored = {k: streams[f"descriptor.{k}"].astype(int) for k in names}
    record = np.repeat(np.arange(len(out["event"])), out["descriptor_count"])
    for k in range(n) if flags & 128 else ():
        detector = directory["detectors"][out["detector"][k]]
        guesses = crossing(detector, out["position"].astype(float), record[k], flags & 256)
        for name, guess in zip(("u", "v", "cosine"), guesses, strict=True):
            stored[name][k] = (guess + zigzag(stored[name][k])) % 2**16
        for name, cells in zip("uv", detector["cells"], strict=True):
            guess = min(stored[name][k] * cells // 65535, cells - 1)
            stored[f"cell_{name}"][k] = (guess + zigzag(stored[f"cell_{name}"][k])) % 2**16
    return stored | {"cosine": stored["cosine"].astype(np.int16)}


def crossing(detector, position, i, reverse):
    w, h = detector.get("size", (1.0, 1.0))
    kind = detector.get("kind", "plane"), detector.get("uv_meaning", "crossing")
    if kind != ("plane", "crossing") or min(w, h) <= 0 or i + 1 == len(position):
        return 0, 0, 0
    p, d = position[i], position[i + 1] - position[i]
    c = np.array(detector.get("center", (0.0, 0.0, 0.0)))
    e, f = detector.get("axis_u", (1.0, 0.0, 0.0)), detector.get("axis_v", (0.0, 1.0, 0.0))
    n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]]
    dn = dot(d, n)
    q = (p + dot(c - p, n) / dn * d) - c
    cosine = rounded(dn / np.sqrt(dot(d, d)) * 32767.0, -32767, 32767)
    uv = (rounded((dot(q, a) / s + 0.5) * 65535.0, 0, 65535) for a, s in ((e, w), (f, h)))
    return *uv, -cosine if reverse else cosine


def colors(channels, streams, out):
    table = 65535 * np.eye(channels, dtype=np.int64)
    if "color.table" in streams:
        mixed = streams["color.table"].astype(np.int64).reshape(-1, max(channels - 1, 1))
        last = 65535 - mixed.sum(1, keepdims=True)
        table = np.concatenate((table, np.hstack((mixed, last))[:, :channels]))
    if "color.code" in streams:
        return table[streams["color.code"]]
    length, later, k = streams["color.length"], streams["color.later"], 0
    codes = np.repeat(streams["color.first"], out["records_per_ray"]).astype(np.int64)
    ends = np.cumsum(out["records_per_ray"])
    for ray, place in enumerate(ends - out["records_per_ray"]):
        for _ in range(streams["color.changes"][ray]):
            place, k = place + length[k], k + 1
            codes[place : ends[ray]] = later[k - 1]
    return table[codes]
