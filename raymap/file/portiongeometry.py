"""The geometry of a stored portion: primitives, positions, normals, places on detectors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.decoding import decodes
from raymap.encoding.portionmeta import DESCRIPTOR_STREAMS, Encoding
from raymap.file.portionstreams import PortionStreams
from raymap.model.errors import FormatError
from raymap.model.portion import Descriptors

__all__ = ["PortionGeometry"]


class PortionGeometry(PortionStreams):
    """Rebuilds what was left out because the shapes of faces and detectors imply it."""

    @decodes
    def descriptors(self, position: NDArray[np.float32] | None = None) -> Descriptors:
        """All meetings with detectors, in record order.

        Parameters
        ----------
        position : the column, where the caller has it: places on flat detectors follow from it
        """
        detector, registered = self._meetings()
        if not self._index.meta.encodings & Encoding.CROSSINGS:
            cell, cosine, uv = self._plain_descriptors()
        else:
            cell, cosine, uv = self._crossings(detector, position)
        self._check_cells(detector, cell)
        return Descriptors(
            detector=detector, cell=cell, cosine=cosine, uv=uv, registered=registered
        )

    def _column_uv(self) -> NDArray[np.uint16]:
        """(n_descriptors, 2) places on the detectors x 65535."""
        return self._pair(DESCRIPTOR_STREAMS[3:], "uv")

    def _column_cell(self) -> NDArray[np.uint16]:
        """(n_descriptors, 2) cells of the detectors."""
        cell = self._pair(DESCRIPTOR_STREAMS[:2], "cell")
        self._check_cells(self._meetings()[0], cell)
        return cell

    def _check_cells(self, detector: NDArray[np.int16], cell: NDArray[np.uint16]) -> None:
        from raymap.encoding.meetings import CheckedMeetings

        try:
            CheckedMeetings.check(detector, cell, self._map.detectors)
        except FormatError as error:
            raise self._damaged(str(error)) from None

    def _pair(self, names: tuple[str, ...], field: str) -> NDArray[np.uint16]:
        """Two of the streams of descriptors, without the others where they stand for themselves."""
        if self._index.meta.encodings & Encoding.CROSSINGS or self.n_descriptors == 0:
            return getattr(self.descriptors(), field)  # type: ignore[no-any-return]
        columns = [self._stream(name, self.n_descriptors, np.uint16) for name in names]
        return np.stack(columns, 1)

    def _plain_descriptors(self) -> tuple[NDArray[Any], ...]:
        n = self.n_descriptors
        if n == 0:
            return np.empty((0, 2), np.uint16), np.empty(0, np.int16), np.empty((0, 2), np.uint16)
        kinds = (np.uint16, np.uint16, np.int16, np.uint16, np.uint16)
        columns = [
            self._stream(name, n, kind)
            for name, kind in zip(DESCRIPTOR_STREAMS, kinds, strict=True)
        ]
        return np.stack(columns[:2], 1), columns[2], np.stack(columns[3:], 1)

    def _crossings(
        self, detector: NDArray[np.int16], position: NDArray[np.float32] | None
    ) -> tuple[NDArray[Any], ...]:
        from raymap.encoding.meetings import decode_meetings

        n = self.n_descriptors
        folded = np.stack([self._stream(name, n, np.uint16) for name in DESCRIPTOR_STREAMS])
        cell, uv = np.empty((n, 2), np.uint16), np.empty((n, 2), np.uint16)
        cosine = np.empty(n, np.int16)
        counts = self._column_descriptor_count()
        self._meeting_offsets(counts)
        decode_meetings(
            counts,
            detector,
            self._column_position() if position is None else position,
            *self._map.detectors,
            bool(self._index.meta.encodings & Encoding.REVERSED),
            folded,
            cell,
            cosine,
            uv,
        )
        return cell, cosine, uv

    def _column_triangle(self) -> NDArray[np.int32]:
        from raymap.encoding.itineraries import face_triangles

        faces = self._map.directory.faces
        if "triangle" in self._streams:
            explicit = self._stream("triangle", None, np.int32)
        else:
            explicit = np.empty(0, np.int32)
        out = np.empty(self.n_records, np.int32)
        if not face_triangles(
            self._points("face"),
            faces.first_primitive,
            faces.primitive_count,
            self._points("object"),
            explicit,
            out,
        ):
            raise self._damaged("primitives do not fit the faces")
        return out

    def _shape_codes(
        self, triangles: NDArray[np.int32] | None
    ) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]:
        """(shape codes, primitives or (0,) where no code needs them, record offsets)."""
        from raymap.encoding.positions import resolve_codes
        from raymap.encoding.shapes import MANY, RayShapes, shape_codes

        paths = self.paths()
        point_codes = np.empty(paths.n_points, np.int32)
        shapes = self._map.shapes
        shape_codes(
            paths.offsets, paths.object, paths.face, paths.event, shapes.face_code, point_codes
        )
        if triangles is None:
            many = self.n_records and bool((point_codes <= MANY).any())
            triangles = self._column_triangle() if many else np.empty(0, np.int32)
        numbers = self.path_numbers()
        offsets = self._record_offsets(numbers) if self.has_paths else paths.offsets
        codes = np.empty(self.n_records, np.int32)
        resolve_codes(
            RayShapes(numbers, paths.offsets, offsets, point_codes, triangles),
            shapes,
            codes,
        )
        return codes, triangles, offsets

    def _column_position(self) -> NDArray[np.float32]:
        position = self._positions()
        # The sum tells at a hundredth of the cost of decoding, unless it overflows by itself
        with np.errstate(over="ignore", invalid="ignore"):
            total = float(position.sum())
        if not math.isfinite(total) and not np.isfinite(position).all():
            raise self._damaged("a position is not finite")
        return position

    def _positions(self) -> NDArray[np.float32]:
        encodings = self._index.meta.encodings
        solve_faces = bool(encodings & Encoding.SOLVED_FACES)
        solve_sphere = bool(encodings & Encoding.SOLVED_SPHERE)
        out = np.empty((self.n_records, 3), np.float32)
        if not solve_faces and not solve_sphere:
            for axis, name in enumerate("xyz"):
                self._read_coordinate(f"position.{name}", axis, out)
            return out
        from raymap.encoding.positions import join_coordinates, solve_positions

        shapes = self._map.shapes
        several = solve_faces and len(shapes.primitive_quadric) > 0
        codes, _, _ = self._shape_codes(None if several else np.empty(0, np.int32))
        x, y, z = (self._stream(f"position.{name}", None, np.float32) for name in "xyz")
        bits = out.view(np.int32)
        solved = np.empty(self.n_records, np.int32)
        n = join_coordinates(
            codes,
            shapes.axis,
            solve_faces,
            solve_sphere,
            x.view(np.int32),
            y.view(np.int32),
            z.view(np.int32),
            bits,
            solved,
        )
        if n < 0:
            raise self._damaged("positions do not fit the paths")
        solve_positions(
            solved[:n],
            codes,
            shapes.solve,
            shapes.axis,
            self._stream("position.residual", n, np.uint32),
            self._stream("position.root", n, np.uint8),
            out,
            bits,
        )
        return out

    def _read_coordinate(self, name: str, axis: int, out: NDArray[np.float32]) -> None:
        from raymap.bytes.planes import join_coordinate
        from raymap.bytes.streams import decode_planes

        try:
            entries = self._streams.get(name, [])
            planes = decode_planes(entries, self.fetch, self.n_records, np.float32)
        except FormatError as error:
            raise self._damaged(str(error)) from None
        if planes is None:
            out[:, axis] = self._stream(name, self.n_records, np.float32)
        else:
            p0, p1, p2, p3 = planes
            join_coordinate(p0, p1, p2, p3, axis, out.view(np.uint32))

    def _column_normal(self) -> NDArray[np.int16]:
        return self._normals(None)

    @decodes
    def normals_at(
        self,
        records: NDArray[np.integer],
        faces: NDArray[np.integer],
        position: NDArray[np.float32],
    ) -> NDArray[np.int16]:
        """(n, 3) normals of some records, without those of all others where faces say them.

        Parameters
        ----------
        records : (n,) places in the portion; faces : (n,) their faces
        position : (n_records, 3), the column
        """
        codes = self._map.shapes.face_code[np.maximum(faces, 0)]
        if not self._index.meta.encodings & Encoding.NORMALS or bool(
            ((faces < 0) | (codes < 0)).any()
        ):
            column: NDArray[np.int16] = self._normals(position)
            return column[np.asarray(records)]
        from raymap.encoding.normals import normals_of_records

        n = self.n_records
        out = np.empty((len(records), 3), np.int16)
        normals_of_records(
            np.asarray(records, np.int64),
            np.asarray(codes, np.int32),
            self._map.shapes.gradient,
            position,
            self._stream("normal.x", n, np.uint16),
            self._stream("normal.y", n, np.uint16),
            self._stream("normal.z", n, np.uint16),
            out,
        )
        return out

    def _normals(self, position: NDArray[np.float32] | None) -> NDArray[np.int16]:
        """Normals; residuals need the positions, which may be there already."""
        out = np.empty((self.n_records, 3), np.int16)
        n = self.n_records
        if not self._index.meta.encodings & Encoding.NORMALS:
            for axis, name in enumerate("xyz"):
                out[:, axis] = self._stream(f"normal.{name}", n, np.int16)
            return out
        from raymap.encoding.normals import decode_normals

        shapes = self._map.shapes
        codes, triangles, offsets = self._shape_codes(None)
        decode_normals(
            offsets,
            codes,
            triangles,
            self._column_source(),
            shapes.gradient,
            shapes.first_primitive,
            shapes.face_start,
            np.zeros((len(self.emitted), 3), np.int16),
            np.zeros((shapes.n_remembered, 3), np.int16),
            self._column_position() if position is None else position,
            self._stream("normal.x", n, np.uint16),
            self._stream("normal.y", n, np.uint16),
            self._stream("normal.z", n, np.uint16),
            out,
        )
        return out
