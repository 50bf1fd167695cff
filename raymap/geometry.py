"""Positions and normals against the shape of the face: what the shape implies is not stored.

All arithmetic is float64 with + - x / and square root in the order written here, so that any
reader gets the same integers. (Compilers must not fuse multiplications and additions.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raymap.kernels import kernel
from raymap.schema import NORMAL_SCALE
from raymap.shapes import EMISSION, LEFT, MANY, RayShapes, ShapeTable

__all__ = ["decode_normals", "decode_positions", "encode_normals", "encode_positions"]

_SCALE = float(NORMAL_SCALE)
_LARGEST = 3.4e38


@kernel
def _ordered(bits: np.uint32) -> np.uint32:
    """Order-preserving code of a float32's bits, modulo 2^32 (its own inverse)."""
    return np.uint32(bits ^ np.uint32(0x7FFFFFFF)) if bits >> np.uint32(31) else np.uint32(bits)


@kernel
def _zigzag(value: np.uint32) -> np.uint32:
    """Small numbers of either sign to small numbers."""
    sign = np.uint32(np.uint32(0) - np.uint32(value >> np.uint32(31)))
    return np.uint32(np.uint32(value << np.uint32(1)) ^ sign)


@kernel
def _unzigzag(code: np.uint32) -> np.uint32:
    sign = np.uint32(np.uint32(0) - np.uint32(code & np.uint32(1)))
    return np.uint32(np.uint32(code >> np.uint32(1)) ^ sign)


@kernel
def _roots(q: NDArray[np.float64], u: float, v: float) -> tuple[float, float]:
    """Both places where the quadric has the other two coordinates u and v."""
    # Compute the coefficients of the quadratic equation
    a = q[0]
    b = (q[1] * u + q[2] * v) + q[3]
    c = (((q[4] * u) * u + (q[5] * v) * v) + (q[6] * u) * v) + ((q[7] * u + q[8] * v) + q[9])
    # Solve it without cancellation
    if a == 0.0:
        t0 = -c / b
        t1 = t0
    else:
        discriminant = b * b - (4.0 * a) * c
        root = math.sqrt(discriminant) if discriminant > 0.0 else 0.0
        s = -0.5 * (b + root) if b >= 0.0 else -0.5 * (b - root)
        t0 = s / a
        t1 = c / s
    # Take 0 for what no float32 can hold, NaN included
    if not (-_LARGEST <= t0 <= _LARGEST):
        t0 = 0.0
    if not (-_LARGEST <= t1 <= _LARGEST):
        t1 = 0.0
    return t0, t1


@kernel
def _quadric_normal(q: NDArray[np.float64], x: float, y: float, z: float) -> tuple[int, int, int]:
    """Normal x 32767 from the gradient."""
    gx = ((2.0 * q[0]) * x + q[3] * y) + (q[4] * z + q[6])
    gy = ((2.0 * q[1]) * y + q[3] * x) + (q[5] * z + q[7])
    gz = ((2.0 * q[2]) * z + q[4] * x) + (q[5] * y + q[8])
    return _scaled(gx, gy, gz)


@kernel
def _scaled(x: float, y: float, z: float) -> tuple[int, int, int]:
    """Direction x 32767, rounded half up; zero where there is none."""
    square = (x * x + y * y) + z * z
    if not (0.0 < square < 1e300):
        return 0, 0, 0
    scale = _SCALE / math.sqrt(square)
    return (
        math.floor(x * scale + 0.5),
        math.floor(y * scale + 0.5),
        math.floor(z * scale + 0.5),
    )


@kernel
def _quadric_of(
    code: int,
    triangle: int,
    shapes: ShapeTable,
    solve_faces: bool,
    solve_sphere: bool,
) -> int:
    """Row of the quadric on which a point lies, -1 none."""
    if code >= 0:
        return code if solve_faces else -1
    if code == LEFT:
        return shapes.axis.size - 1 if solve_sphere else -1
    if code <= MANY and solve_faces and shapes.primitive_quadric.size:
        face = MANY - code
        return int(
            shapes.primitive_quadric[
                shapes.face_start[face] + triangle - shapes.first_primitive[face]
            ]
        )
    return -1


@kernel
def encode_positions(
    rays: RayShapes,
    shapes: ShapeTable,
    solve_faces: bool,
    solve_sphere: bool,
    position: NDArray[np.float32],
    bits: NDArray[np.uint32],
    raw: NDArray[np.uint8],
    residual: NDArray[np.uint8],
    roots: NDArray[np.uint8],
    counts: NDArray[np.int64],
) -> None:
    """Byte planes of the coordinates stored as they are, and of the residuals of those solved.

    Parameters
    ----------
    position, bits : (n_records, 3), the same memory as float32 and as uint32
    raw : (3, 4, n_records) out, planes of each coordinate, in record order, solved ones left out
    residual : (4, n_records) out, planes of the zigzag of (stored - root) in float32 steps
    roots : (n_records,) out, 1 where another root than the quadric's last time is meant
    counts : (8,) out: stored x, y, z, solved, bits of face residuals, faces, of sphere, sphere
    """
    sphere = shapes.axis.size - 1
    last_root = np.zeros(shapes.axis.size, np.uint8)
    stored = np.zeros(3, np.int64)
    solved = 0
    face_bits = 0
    sphere_bits = 0
    on_sphere = 0
    value = np.empty(1, np.float32)
    value_bits = value.view(np.uint32)
    for ray in range(rays.numbers.size):
        row = rays.path_offsets[rays.numbers[ray]] - rays.record_offsets[ray]
        for i in range(rays.record_offsets[ray], rays.record_offsets[ray + 1]):
            q = _quadric_of(
                rays.codes[row + i], rays.triangles[i], shapes, solve_faces, solve_sphere
            )
            a = shapes.axis[q] if q >= 0 else -1
            # Store the coordinates that are not solved for
            for k in range(3):
                if k != a:
                    b = bits[i, k]
                    n = stored[k]
                    raw[k, 0, n] = np.uint8(b)
                    raw[k, 1, n] = np.uint8(b >> np.uint32(8))
                    raw[k, 2, n] = np.uint8(b >> np.uint32(16))
                    raw[k, 3, n] = np.uint8(b >> np.uint32(24))
                    stored[k] = n + 1
            if a < 0:
                continue
            # Store the other one as its distance from the nearer root
            u = np.float64(position[i, 1 if a == 0 else 0])
            v = np.float64(position[i, 1 if a == 2 else 2])
            t0, t1 = _roots(shapes.solve[q], u, v)
            here = _ordered(bits[i, a])
            value[0] = t0
            r0 = _zigzag(np.uint32(here - _ordered(value_bits[0])))
            value[0] = t1
            r1 = _zigzag(np.uint32(here - _ordered(value_bits[0])))
            root = np.uint8(1) if r1 < r0 else np.uint8(0)
            r = r1 if r1 < r0 else r0
            roots[solved] = root ^ last_root[q]
            last_root[q] = root
            residual[0, solved] = np.uint8(r)
            residual[1, solved] = np.uint8(r >> np.uint32(8))
            residual[2, solved] = np.uint8(r >> np.uint32(16))
            residual[3, solved] = np.uint8(r >> np.uint32(24))
            solved += 1
            length = 0
            while r:
                length += 8
                r = np.uint32(r >> np.uint32(8))
            if q == sphere:
                sphere_bits += length
                on_sphere += 1
            else:
                face_bits += length
    counts[0] = stored[0]
    counts[1] = stored[1]
    counts[2] = stored[2]
    counts[3] = solved
    counts[4] = face_bits
    counts[5] = solved - on_sphere
    counts[6] = sphere_bits
    counts[7] = on_sphere


@kernel
def decode_positions(
    rays: RayShapes,
    shapes: ShapeTable,
    solve_faces: bool,
    solve_sphere: bool,
    xs: NDArray[np.uint32],
    ys: NDArray[np.uint32],
    zs: NDArray[np.uint32],
    residual: NDArray[np.uint32],
    roots: NDArray[np.uint8],
    position: NDArray[np.float32],
    bits: NDArray[np.uint32],
) -> bool:
    """The inverse of `encode_positions`; false where the streams do not fit the paths.

    Parameters
    ----------
    triangles : (n_records,), or (0,) where no face needs it
    position, bits : (n_records, 3) out, the same memory as float32 and as uint32
    """
    last_root = np.zeros(shapes.axis.size, np.uint8)
    nx = 0
    ny = 0
    nz = 0
    solved = 0
    value = np.empty(1, np.float32)
    value_bits = value.view(np.uint32)
    has_triangles = rays.triangles.size > 0
    for ray in range(rays.numbers.size):
        row = rays.path_offsets[rays.numbers[ray]] - rays.record_offsets[ray]
        for i in range(rays.record_offsets[ray], rays.record_offsets[ray + 1]):
            q = _quadric_of(
                rays.codes[row + i],
                rays.triangles[i] if has_triangles else -1,
                shapes,
                solve_faces,
                solve_sphere,
            )
            a = shapes.axis[q] if q >= 0 else -1
            if a != 0:
                if nx == xs.size:
                    return False
                bits[i, 0] = xs[nx]
                nx += 1
            if a != 1:
                if ny == ys.size:
                    return False
                bits[i, 1] = ys[ny]
                ny += 1
            if a != 2:
                if nz == zs.size:
                    return False
                bits[i, 2] = zs[nz]
                nz += 1
            if a < 0:
                continue
            # Solve for the coordinate left out
            if solved == residual.size:
                return False
            u = np.float64(position[i, 1 if a == 0 else 0])
            v = np.float64(position[i, 1 if a == 2 else 2])
            t0, t1 = _roots(shapes.solve[q], u, v)
            last_root[q] ^= roots[solved]
            value[0] = t1 if last_root[q] else t0
            here = np.uint32(_ordered(value_bits[0]) + _unzigzag(residual[solved]))
            bits[i, a] = _ordered(here)
            solved += 1
    return nx == xs.size and ny == ys.size and nz == zs.size and solved == residual.size


@kernel
def _predicted(
    i: int,
    code: int,
    triangle: int,
    source: int,
    shapes: ShapeTable,
    position: NDArray[np.float32],
    emission: NDArray[np.int16],
    remembered: NDArray[np.int16],
) -> tuple[int, int, int]:
    """The normal that a record should have, from its shape or from normals met before."""
    if code == EMISSION:
        return int(emission[source, 0]), int(emission[source, 1]), int(emission[source, 2])
    if code == LEFT:
        return _scaled(
            np.float64(position[i, 0]) - np.float64(position[i - 1, 0]),
            np.float64(position[i, 1]) - np.float64(position[i - 1, 1]),
            np.float64(position[i, 2]) - np.float64(position[i - 1, 2]),
        )
    q = code
    if code <= MANY:
        face = MANY - code
        primitive = shapes.face_start[face] + triangle - shapes.first_primitive[face]
        q = shapes.primitive_quadric[primitive] if shapes.primitive_quadric.size else -1
        if q < 0 and remembered.shape[0]:
            return (
                int(remembered[primitive, 0]),
                int(remembered[primitive, 1]),
                int(remembered[primitive, 2]),
            )
    if q < 0:
        return 0, 0, 0
    return _quadric_normal(
        shapes.gradient[q],
        np.float64(position[i, 0]),
        np.float64(position[i, 1]),
        np.float64(position[i, 2]),
    )


@kernel
def _remember(
    i: int,
    code: int,
    triangle: int,
    source: int,
    shapes: ShapeTable,
    normal: NDArray[np.int16],
    emission: NDArray[np.int16],
    remembered: NDArray[np.int16],
) -> None:
    if code == EMISSION:
        for k in range(3):
            emission[source, k] = normal[i, k]
    elif code <= MANY and remembered.shape[0]:
        face = MANY - code
        primitive = shapes.face_start[face] + triangle - shapes.first_primitive[face]
        for k in range(3):
            remembered[primitive, k] = normal[i, k]


@kernel
def encode_normals(
    rays: RayShapes,
    sources: NDArray[np.int16],
    shapes: ShapeTable,
    emission: NDArray[np.int16],
    remembered: NDArray[np.int16],
    position: NDArray[np.float32],
    normal: NDArray[np.int16],
    planes: NDArray[np.uint8],
) -> tuple[int, int]:
    """Byte planes of the zigzag of (stored - predicted) modulo 2^16.

    Parameters
    ----------
    emission : (n_sources, 3) zeros; remembered : (n_remembered, 3) zeros
    planes : (3, 2, n_records) out

    Returns
    -------
    missed, plain : components that the prediction misses, components that are not zero
    """
    missed = 0
    plain = 0
    for ray in range(rays.numbers.size):
        row = rays.path_offsets[rays.numbers[ray]] - rays.record_offsets[ray]
        source = sources[ray]
        for i in range(rays.record_offsets[ray], rays.record_offsets[ray + 1]):
            code = rays.codes[row + i]
            p = _predicted(
                i,
                code,
                rays.triangles[i],
                source,
                shapes,
                position,
                emission,
                remembered,
            )
            for k in range(3):
                r = np.uint16(np.uint16(normal[i, k]) - np.uint16(p[k]))
                sign = np.uint16(np.uint16(0) - np.uint16(r >> np.uint16(15)))
                z = np.uint16(np.uint16(r << np.uint16(1)) ^ sign)
                planes[k, 0, i] = np.uint8(z)
                planes[k, 1, i] = np.uint8(z >> np.uint16(8))
                missed += z != 0
                plain += normal[i, k] != 0
            if code < 0:
                _remember(
                    i,
                    code,
                    rays.triangles[i],
                    source,
                    shapes,
                    normal,
                    emission,
                    remembered,
                )
    return missed, plain


@kernel
def decode_normals(
    rays: RayShapes,
    sources: NDArray[np.int16],
    shapes: ShapeTable,
    emission: NDArray[np.int16],
    remembered: NDArray[np.int16],
    position: NDArray[np.float32],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    z: NDArray[np.uint16],
    normal: NDArray[np.int16],
) -> None:
    """The inverse of `encode_normals`."""
    has_triangles = rays.triangles.size > 0
    for ray in range(rays.numbers.size):
        row = rays.path_offsets[rays.numbers[ray]] - rays.record_offsets[ray]
        source = sources[ray]
        for i in range(rays.record_offsets[ray], rays.record_offsets[ray + 1]):
            code = rays.codes[row + i]
            triangle = rays.triangles[i] if has_triangles else -1
            p = _predicted(
                i,
                code,
                triangle,
                source,
                shapes,
                position,
                emission,
                remembered,
            )
            for k in range(3):
                code_k = x[i] if k == 0 else (y[i] if k == 1 else z[i])
                sign = np.uint16(np.uint16(0) - np.uint16(code_k & np.uint16(1)))
                r = np.uint16(np.uint16(code_k >> np.uint16(1)) ^ sign)
                normal[i, k] = np.int16(np.uint16(np.uint16(p[k]) + r))
            if code < 0:
                _remember(
                    i,
                    code,
                    triangle,
                    source,
                    shapes,
                    normal,
                    emission,
                    remembered,
                )
