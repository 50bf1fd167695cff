"""The cleavage rhombohedron of calcite as a body of the scene description."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tracer.bodies.body import Body, FacePlan
from tracer.description.fields import Positive
from tracer.geometry.shapes import Polygon

__all__ = ["RhombBody"]

Array = NDArray[np.float64]


class RhombBody(Body):
    """A cleavage rhombohedron with edges of length ``edge``.

    It lies on a face below the position, the middle of that face at the position. The optic axis of
    a crystal without ``optic_axis`` or ``axes`` is where nature has it in calcite.
    """

    kind: Literal["rhomb"]
    edge: Positive

    def hull(self) -> tuple[Array, Array]:
        """Planes (6, 4) and optic axis (3,), in the scene."""
        from tracer.crystals.bodies import calcite_rhomb
        from tracer.crystals.media import calcite

        axes: list[Any] = []

        def medium(axis: Any) -> Any:
            axes.append(axis)
            return calcite(axis)

        body = calcite_rhomb("rhomb", medium, self.edge, (0.0, 0.0, 0.0))
        origin, frame = self.frame()
        normals = body.planes[:, :3] @ frame.T
        planes = np.column_stack([normals, body.planes[:, 3] + normals @ origin])
        return planes, np.asarray(frame @ axes[0])

    def plan(self) -> list[FacePlan]:
        from tracer.crystals.bodies import convex_body
        from tracer.crystals.hulls import face_names, face_rings
        from tracer.crystals.media import isotropic

        body = convex_body("rhomb", isotropic(1.0), self.hull()[0])
        return [
            FacePlan(name=name, shapes=(Polygon(body.vertices[ring]),))
            for name, ring in zip(face_names(body), face_rings(body), strict=True)
        ]
