"""The door to Embree: build a scene of triangles, and let compiled code ask it for hits.

The ``embreex`` wheel carries the Embree library; this module talks to its C interface (version 4)
and makes ``rtcIntersect1`` known to compiled kernels by name, so that they call it without passing
through Python. Embree computes in float32; `tracer.geometry.mesh_hits` refines in float64.

References
----------
I. Wald, S. Woop, C. Benthin, G. S. Johnson, M. Ernst, ACM Trans. Graphics 33(4), 143 (2014).
"""

from __future__ import annotations

import ctypes
import weakref
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding
from numba import types
from numpy.typing import NDArray

from raymap.model.errors import RayMapError

__all__ = ["INVALID", "RAYHIT_WORDS", "EmbreeScene", "intersect"]

INVALID = 0xFFFFFFFF
"""Embree's id for "no geometry"."""

RAYHIT_WORDS = 24
"""32-bit words of RTCRayHit, rounded up to its alignment: 12 of the ray, 9 of the hit."""

_TRIANGLES, _INSTANCE = 0, 121
_INDEX_BUFFER, _VERTEX_BUFFER = 0, 1
_UINT3, _FLOAT3, _FLOAT3X4_ROWS = 0x5003, 0x9003, 0x9134
_ROBUST = 4
_HIGH_QUALITY = 2


class EmbreeError(RayMapError, RuntimeError):
    """Embree refused or ran out of memory."""


def _find_library() -> Path:
    """The library that the wheel carries beside its extension modules."""
    import embreex

    package = Path(embreex.__file__).parent
    places = (package.parent / "embreex.libs", package / ".dylibs", package / ".libs", package)
    for path in places:
        for pattern in ("libembree4*", "embree4*.dll"):
            for found in sorted(path.glob(pattern)):
                return found
    raise EmbreeError(
        f"Embree's library was not found beside {package}: meshes cannot be traced; "
        "reinstall the package embreex from its wheel"
    )


def _load() -> Any:
    import embreex.rtcore_scene  # noqa: F401  (brings the library and what it depends on)

    library = ctypes.CDLL(str(_find_library()))
    pointer, unsigned, size, integer = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t, ctypes.c_int
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "rtcNewDevice": (pointer, [ctypes.c_char_p]),
        "rtcReleaseDevice": (None, [pointer]),
        "rtcGetDeviceError": (integer, [pointer]),
        "rtcNewScene": (pointer, [pointer]),
        "rtcReleaseScene": (None, [pointer]),
        "rtcSetSceneFlags": (None, [pointer, integer]),
        "rtcSetSceneBuildQuality": (None, [pointer, integer]),
        "rtcCommitScene": (None, [pointer]),
        "rtcNewGeometry": (pointer, [pointer, integer]),
        "rtcReleaseGeometry": (None, [pointer]),
        "rtcCommitGeometry": (None, [pointer]),
        "rtcAttachGeometryByID": (None, [pointer, pointer, unsigned]),
        "rtcSetNewGeometryBuffer": (
            pointer,
            [pointer, integer, unsigned, integer, size, size],
        ),
        "rtcSetGeometryInstancedScene": (None, [pointer, pointer]),
        "rtcSetGeometryTimeStepCount": (None, [pointer, unsigned]),
        "rtcSetGeometryTransform": (None, [pointer, unsigned, integer, pointer]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    address = ctypes.cast(library.rtcIntersect1, ctypes.c_void_p).value
    binding.add_symbol("rtcIntersect1", address)
    return library


_LIBRARY = _load()

intersect = types.ExternalFunction(
    "rtcIntersect1", types.void(types.uintp, types.uintp, types.uintp)
)
"""rtcIntersect1(scene, address of an RTCRayHit, 0), for compiled code. Thread-safe."""


class EmbreeScene:
    """Triangle meshes and instances of them under object numbers; released with this object.

    Parameters
    ----------
    high_quality : spend more time on building for faster queries
    """

    def __init__(self, *, high_quality: bool = True) -> None:
        self._device = _LIBRARY.rtcNewDevice(b"")
        if not self._device:
            raise EmbreeError("Embree could not be started: meshes cannot be traced on this CPU")
        self._children: list[int] = []
        self._quality = _HIGH_QUALITY if high_quality else 1
        self.handle: int = self._new_scene()
        self._finalizer = weakref.finalize(
            self, _release, self._device, self.handle, self._children
        )

    def add_mesh(
        self, number: int, vertices: NDArray[np.floating], triangles: NDArray[np.integer]
    ) -> None:
        """Attach a mesh as object ``number``: vertices (n, 3), triangles (m, 3) vertex indices."""
        self._attach_mesh(self.handle, number, vertices, triangles)

    def add_prototype(self, vertices: NDArray[np.floating], triangles: NDArray[np.integer]) -> int:
        """Build a mesh of which `add_instance` places copies; returns its handle."""
        child = self._new_scene()
        self._children.append(child)
        self._attach_mesh(child, 0, vertices, triangles)
        _LIBRARY.rtcCommitScene(child)
        return child

    def add_instance(self, number: int, prototype: int, transform: NDArray[np.float64]) -> None:
        """Place a prototype as object ``number``; ``transform`` (3, 4) local to world."""
        geometry = _LIBRARY.rtcNewGeometry(self._device, _INSTANCE)
        _LIBRARY.rtcSetGeometryInstancedScene(geometry, prototype)
        _LIBRARY.rtcSetGeometryTimeStepCount(geometry, 1)
        rows = np.ascontiguousarray(transform[:3, :4], np.float32)
        _LIBRARY.rtcSetGeometryTransform(geometry, 0, _FLOAT3X4_ROWS, rows.ctypes.data)
        _LIBRARY.rtcCommitGeometry(geometry)
        _LIBRARY.rtcAttachGeometryByID(self.handle, geometry, number)
        _LIBRARY.rtcReleaseGeometry(geometry)

    def commit(self) -> None:
        """Build the search tree; afterwards any number of threads may query."""
        _LIBRARY.rtcCommitScene(self.handle)
        code = _LIBRARY.rtcGetDeviceError(self._device)
        if code:
            reason = {4: "out of memory", 5: "this CPU is not supported"}.get(code, f"error {code}")
            raise EmbreeError(f"Embree could not build the meshes: {reason}")

    def _new_scene(self) -> int:
        scene: int = _LIBRARY.rtcNewScene(self._device)
        # Robust: a ray through a shared edge hits one of the two triangles
        _LIBRARY.rtcSetSceneFlags(scene, _ROBUST)
        _LIBRARY.rtcSetSceneBuildQuality(scene, self._quality)
        return scene

    def _attach_mesh(
        self, scene: int, number: int, vertices: NDArray[Any], triangles: NDArray[Any]
    ) -> None:
        geometry = _LIBRARY.rtcNewGeometry(self._device, _TRIANGLES)
        self._fill(geometry, _VERTEX_BUFFER, _FLOAT3, np.ascontiguousarray(vertices, np.float32))
        self._fill(geometry, _INDEX_BUFFER, _UINT3, np.ascontiguousarray(triangles, np.uint32))
        _LIBRARY.rtcCommitGeometry(geometry)
        _LIBRARY.rtcAttachGeometryByID(scene, geometry, number)
        _LIBRARY.rtcReleaseGeometry(geometry)

    @staticmethod
    def _fill(geometry: int, kind: int, layout: int, rows: NDArray[Any]) -> None:
        address = _LIBRARY.rtcSetNewGeometryBuffer(geometry, kind, 0, layout, 12, len(rows))
        if not address:
            raise EmbreeError(f"Embree has no memory for a buffer of {len(rows)} rows")
        ctypes.memmove(address, rows.ctypes.data, rows.nbytes)


def _release(device: int, scene: int, children: list[int]) -> None:
    for handle in (scene, *children):
        _LIBRARY.rtcReleaseScene(handle)
    _LIBRARY.rtcReleaseDevice(device)
