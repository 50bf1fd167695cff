"""The geometry of a stored portion: primitives, positions, normals, places on detectors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from raymap.bytes.decoding import decodes
from raymap.encoding.portionmeta import DESCRIPTOR_STREAMS, Encoding
from raymap.file.portionstreams import PortionStreams
from raymap.model.portion import Descriptors

if TYPE_CHECKING:
    from raymap.encoding.normals import Folded
    from raymap.encoding.shapes import ShapedRecords

__all__ = ["PortionGeometry"]


class PortionGeometry(PortionStreams):
    """Rebuilds what was left out because the shapes of faces and detectors imply it."""

    @decodes
    def descriptors(self, position: NDArray[np.float32] | None = None) -> Descriptors:
        """All crossings of detectors, in record order.

        Parameters
        ----------
        position : the column, where the caller has it: places on flat detectors follow from it
        """
        detector, registered = self._crossed()
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
        self._check_cells(self._crossed()[0], cell)
        return cell

    def _check_cells(self, detector: NDArray[np.int16], cell: NDArray[np.uint16]) -> None:
        from raymap.encoding.detector_crossings import CheckedCrossings

        with self._damage():
            CheckedCrossings.check(detector, cell, self._map.detectors)

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
        from raymap.encoding.detector_crossings import FoldedCrossings

        n = self.n_descriptors
        folded = np.stack([self._stream(name, n, np.uint16) for name in DESCRIPTOR_STREAMS])
        counts = self._column_descriptor_count()
        if position is None:
            position = self._column_position()
        with self._damage():
            crossings = FoldedCrossings.check(
                counts, detector, position, folded, self._map.detectors
            )
        return crossings.unfold(reverse=bool(self._index.meta.encodings & Encoding.REVERSED))

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

    def _shaped_records(self, *, primitives: bool = True) -> ShapedRecords:
        """The records with their shapes.

        Parameters
        ----------
        primitives : read those of faces of several, which tell quadrics and normals apart
        """
        from raymap.encoding.shapes import MANY, ShapedRecords, point_shapes

        paths = self.paths()
        shapes, triangles = self._map.shapes, np.empty(0, np.int32)
        with self._damage():
            codes = point_shapes(paths.offsets, paths.object, paths.face, paths.event, shapes)
            if primitives and self.n_records and bool((codes <= MANY).any()):
                triangles = self._column_triangle()
            runs = self._runs(paths.offsets, self.path_numbers())
            return ShapedRecords.check(runs, codes, triangles, shapes)

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
        if not solve_faces and not solve_sphere:
            out = np.empty((self.n_records, 3), np.float32)
            for axis, name in enumerate("xyz"):
                self._read_coordinate(f"position.{name}", axis, out)
            return out
        from raymap.encoding.positions import rebuild_positions

        several = solve_faces and len(self._map.shapes.primitive_quadric) > 0
        records = self._shaped_records(primitives=several)
        with self._damage():
            return rebuild_positions(
                records, self._stream, solve_faces=solve_faces, solve_sphere=solve_sphere
            )

    def _read_coordinate(self, name: str, axis: int, out: NDArray[np.float32]) -> None:
        from raymap.bytes.planes import join_coordinate
        from raymap.bytes.streams import decode_planes

        with self._damage():
            entries = self._streams.get(name, [])
            planes = decode_planes(entries, self.fetch, self.n_records, np.float32)
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
        from raymap.encoding.normals import rebuild_some_normals

        with self._damage():
            return rebuild_some_normals(
                self._map.shapes, records, faces, position, self._folded_normals()
            )

    def _normals(self, position: NDArray[np.float32] | None) -> NDArray[np.int16]:
        """Normals; residuals need the positions, which may be there already."""
        if not self._index.meta.encodings & Encoding.NORMALS:
            out = np.empty((self.n_records, 3), np.int16)
            for axis, name in enumerate("xyz"):
                out[:, axis] = self._stream(f"normal.{name}", self.n_records, np.int16)
            return out
        from raymap.encoding.normals import rebuild_normals

        records = self._shaped_records()
        if position is None:
            position = self._column_position()
        with self._damage():
            return rebuild_normals(
                records, self._column_source(), len(self.emitted), position, self._folded_normals()
            )

    def _folded_normals(self) -> Folded:
        """How far normals are off what is implied: x, y, z."""
        x, y, z = (self._stream(f"normal.{axis}", self.n_records, np.uint16) for axis in "xyz")
        return x, y, z
