"""The waves of a medium in the frame of an interface: normal along z, plane of incidence xz."""

from __future__ import annotations

from typing import Any

import numpy as np

from raymap.jit.kernels import inner_kernel
from raymap.optics.frames import frame_towards
from tracer.optics.crystals.modes import TurnedMedium, forward_modes, mirror_modes
from tracer.optics.crystals.rows import (
    AXIS,
    BIAXIAL,
    EPS,
    EPS_EXTRAORDINARY,
    EPS_ORDINARY,
    KIND,
    UNIAXIAL,
)

__all__ = ["interface_frame", "medium_modes"]

Array = np.ndarray[Any, np.dtype[Any]]


@inner_kernel
def interface_frame(
    nx: float, ny: float, nz: float, px: float, py: float, pz: float, frame: Array
) -> float:
    """Axes x, y, z (rows 0 to 2) of the interface; returns xi = |tangential N|.

    n = (nx, ny, nz) is the unit normal, p = N of the incident wave.
    """
    sx, sy = (1.0, 0.0) if abs(nx) < 0.6 else (0.0, 1.0)
    xi, tx, ty, tz, ux, uy, uz = frame_towards(nx, ny, nz, px, py, pz, sx, sy, 0.0)
    frame[0, 0], frame[0, 1], frame[0, 2] = tx, ty, tz
    frame[1, 0], frame[1, 1], frame[1, 2] = ux, uy, uz
    frame[2, 0], frame[2, 1], frame[2, 2] = nx, ny, nz
    return xi


@inner_kernel
def medium_modes(
    medium: Array,
    frame: Array,
    xi: float,
    sign: float,
    hint: float,
    modes: Array,
    k: int,
    work: Array,
    cwork: Array,
) -> None:
    """Two forward (sign = 1) or backward (-1) waves of a medium row in the interface frame.

    ``hint``: q of a grazing wave that travels the other way, or nan.
    """
    kind = int(medium[KIND])
    tensor = frame[3]
    cx = cy = cz = 0.0
    if kind == UNIAXIAL:
        # Turn the axis into the frame; the tensor follows from it
        ax, ay, az = medium[AXIS], medium[AXIS + 1], medium[AXIS + 2]
        cx = frame[0, 0] * ax + frame[0, 1] * ay + frame[0, 2] * az
        cy = frame[1, 0] * ax + frame[1, 1] * ay + frame[1, 2] * az
        cz = sign * (frame[2, 0] * ax + frame[2, 1] * ay + frame[2, 2] * az)
        eo = medium[EPS_ORDINARY]
        de = medium[EPS_EXTRAORDINARY] - eo
        tensor[0] = eo + de * cx * cx
        tensor[1] = eo + de * cy * cy
        tensor[2] = eo + de * cz * cz
        tensor[3] = de * cx * cy
        tensor[4] = de * cx * cz
        tensor[5] = de * cy * cz
    elif kind == BIAXIAL:
        # Turn the tensor into the frame
        for i in range(3):
            x, y, z = frame[i, 0], frame[i, 1], frame[i, 2]
            frame[5, i] = medium[EPS] * x + medium[EPS + 3] * y + medium[EPS + 4] * z
            frame[6, i] = medium[EPS + 3] * x + medium[EPS + 1] * y + medium[EPS + 5] * z
            frame[7, i] = medium[EPS + 4] * x + medium[EPS + 5] * y + medium[EPS + 2] * z
        for entry in range(6):
            i = 0 if entry in (3, 4) else (1 if entry == 5 else entry)
            j = 1 if entry == 3 else (2 if entry > 3 else entry)
            tensor[entry] = (
                frame[i, 0] * frame[5, j] + frame[i, 1] * frame[6, j] + frame[i, 2] * frame[7, j]
            )
        tensor[4] *= sign
        tensor[5] *= sign
    turned = TurnedMedium(kind, tensor, medium[EPS_ORDINARY], medium[EPS_EXTRAORDINARY], cx, cy, cz)
    forward_modes(turned, xi, sign * hint, modes, k, work, cwork)
    if sign < 0.0:
        mirror_modes(modes, k)
