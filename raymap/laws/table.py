"""Reflectance and transmittance of an interface by channel and angle.

For evaluation the law is one table per channel, of reflectance R and transmittance T on both sides
over the cosine on the *rarer* side of the interface (nothing bends sharply there), and of R beyond
the critical angle. What R + T leaves is absorbed. Bare interfaces use `raymap.optics.fresnel`.
Total reflection stays total unless layers absorb (`raymap.laws.stack`).
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import FailFast, model_validator

from raymap.jit.kernels import inner_kernel, lean_kernel
from raymap.laws.jones import EVEN, TABLES, JonesRow
from raymap.laws.law import ByChannel, InChannels, Law, Shares
from raymap.laws.radial import RadialScatter, scatter_tables
from raymap.model.errors import SceneError
from raymap.optics.fresnel import cos2_refracted

__all__ = [
    "COATING_ANGLES",
    "COATING_SIZE",
    "TableLaw",
    "coating_share",
    "constant_coating",
    "measured_at_channels",
    "shares_of_tables",
    "tables_over_angle",
    "tabulated_coating",
]

F64 = NDArray[np.float64]

COATING_ANGLES = 181
"""Nodes of a coating's table."""

COATING_SIZE = 4 * COATING_ANGLES
"""Numbers of a table: R from the rarer side, R from the denser side, T, R beyond critical."""


class TableLaw(Law):
    """A smooth interface of given reflectance and transmittance; the rest is absorbed.

    Attributes
    ----------
    angle_deg : (a,) angles of incidence on the rarer side, rising
    reflectance, transmittance : of natural light, a row per channel, of one value per angle; the
        end values hold beyond the angles, and beyond the critical angle all is reflected
    reflectance_s, transmittance_s : of light that vibrates across the plane of incidence, where
        that is known; p has as much more as s has less
    scatter : takes its share of the specular light
    """

    law: Literal["table"] = "table"
    angle_deg: Annotated[tuple[float, ...], FailFast()]
    reflectance: Annotated[tuple[ByChannel, ...], FailFast()]
    transmittance: Annotated[tuple[ByChannel, ...], FailFast()]
    scatter: RadialScatter | None = None
    reflectance_s: Annotated[tuple[ByChannel, ...], FailFast()] = ()
    transmittance_s: Annotated[tuple[ByChannel, ...], FailFast()] = ()

    @model_validator(mode="after")
    def _check(self) -> TableLaw:
        rows = (*self.reflectance, *self.transmittance, *self.reflectance_s, *self.transmittance_s)
        if {len(self.reflectance_s), len(self.transmittance_s)} not in (
            {0},
            {len(self.reflectance)},
        ):
            raise ValueError("shares of s go with both reflectance and transmittance, by channel")
        if len(self.reflectance) != len(self.transmittance):
            raise ValueError("reflectance and transmittance are of other channels")
        if not self.angle_deg or any(len(row) != len(self.angle_deg) for row in rows):
            raise ValueError(f"a row has other values than the {len(self.angle_deg)} angles")
        if any(b <= a for a, b in zip(self.angle_deg, self.angle_deg[1:], strict=False)):
            raise ValueError("angles must rise")
        for back, through in zip(self.reflectance, self.transmittance, strict=True):
            if any(r + t > 1.0 + 1e-9 for r, t in zip(back, through, strict=True)):
                raise ValueError("reflectance + transmittance exceeds 1")
        return self

    def tables(self) -> F64:
        """(n_channels, COATING_SIZE) for `coating_share`."""
        return tables_over_angle(self.angle_deg, self.reflectance, self.transmittance)

    def _shares(self, channels: InChannels, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
        return shares_of_tables(self.tables(), n_i, n_o, cos_i)

    def jones(self, channels: InChannels) -> JonesRow | None:
        tables = self.tables()
        if not self.reflectance_s:
            return JonesRow(
                form=EVEN,
                numbers=tables,
                scatter=scatter_tables(self.scatter, channels.wavelengths_nm),
            )
        s = tables_over_angle(self.angle_deg, self.reflectance_s, self.transmittance_s)
        numbers = np.hstack([tables, s, np.maximum(0.0, 2.0 * tables - s)])
        return JonesRow(
            form=TABLES,
            numbers=numbers,
            scatter=scatter_tables(self.scatter, channels.wavelengths_nm),
        )


def shares_of_tables(tables: F64, n_i: F64, n_o: F64, cos_i: F64) -> Shares:
    """(n_channels, n_angles) reflectance and transmittance of tables, one per channel."""
    reflected, transmitted = np.empty((2, len(tables), len(cos_i)))
    for channel, table in enumerate(tables):
        _fill_shares(
            table, float(n_i[channel]), float(n_o[channel]), np.asarray(cos_i, np.float64),
            reflected[channel], transmitted[channel],
        )  # fmt: skip
    return reflected, transmitted


@lean_kernel
def coating_share(
    tables: F64, first: int, n_i: float, n_o: float, cos_i: float
) -> tuple[float, float]:
    """Reflectance and transmittance of a coated interface for unpolarised light.

    Parameters
    ----------
    tables, first : flat pool, and where the table of this coating and channel stands in it
    n_i, n_o : indices on the incident side and beyond
    cos_i : cosine of the angle of incidence

    Returns
    -------
    R, T : what they leave to 1 is absorbed
    """
    # From the rarer side the cosine is the table's own
    if n_i <= n_o:
        column, x = 0, cos_i
    else:
        ratio = n_i / n_o
        square = cos2_refracted(ratio, cos_i)
        if square < 0.0:
            # Beyond the critical angle: from there (0) to grazing (1)
            critical = math.sqrt(max(0.0, 1.0 - 1.0 / (ratio * ratio)))
            x = 1.0 - cos_i / critical if critical > 0.0 else 1.0
            return _at(tables, first + 3 * COATING_ANGLES, x), 0.0
        column, x = 1, math.sqrt(square)
    reflected = _at(tables, first + column * COATING_ANGLES, x)
    return reflected, _at(tables, first + 2 * COATING_ANGLES, x)


@lean_kernel
def _fill_shares(
    table: F64, n_i: float, n_o: float, cos_i: F64, reflected: F64, transmitted: F64
) -> None:
    for i in range(len(cos_i)):
        reflected[i], transmitted[i] = coating_share(table, 0, n_i, n_o, cos_i[i])


@inner_kernel
def _at(tables: F64, first: int, x: float) -> float:
    place = min(1.0, max(0.0, x)) * (COATING_ANGLES - 1)
    low = min(COATING_ANGLES - 2, int(place))
    value = tables[first + low]
    return float(value + (place - low) * (tables[first + low + 1] - value))


def constant_coating(reflectance: ArrayLike, *, name: str = "") -> F64:
    """Tables of a coating that reflects the same share at all angles and absorbs nothing.

    Parameters
    ----------
    reflectance : (n_channels,)

    Returns
    -------
    tables : (n_channels, size); beyond the critical angle reflection is total
    """
    shares = np.atleast_1d(np.asarray(reflectance, np.float64))
    if not np.all((shares >= 0.0) & (shares <= 1.0)):
        raise SceneError(f"surface {name!r}: a coating's reflectance must lie between 0 and 1")
    table = np.ones((len(shares), COATING_SIZE))
    table[:, : 2 * COATING_ANGLES] = shares[:, None]
    table[:, 2 * COATING_ANGLES : 3 * COATING_ANGLES] = 1.0 - shares[:, None]
    return table


def tabulated_coating(
    wavelengths_nm: ArrayLike,
    table_nm: ArrayLike,
    angle_deg: ArrayLike,
    reflectance: ArrayLike,
    transmittance: ArrayLike,
    *,
    name: str = "",
) -> F64:
    """Tables of a measured coating.

    Parameters
    ----------
    wavelengths_nm : (n_channels,) of the trace
    table_nm : (w,) wavelengths of the measurement, rising [nm]
    angle_deg : (a,) angles of incidence on the rarer side, rising, within 0 .. 90 [deg]
    reflectance, transmittance : (w, a) shares of flux; the rest is absorbed
    name : of the surface, for messages

    Returns
    -------
    tables : (n_channels, size). Both sides share R and T (at angles that Snell's law joins), as
        they do without absorption; beyond the critical angle reflection is total. Interpolation is
        linear; outside the angles the end values hold.

    Raises
    ------
    SceneError
        if R + T exceeds 1 somewhere, or the wavelengths do not cover the channels
    """
    back, through = measured_at_channels(
        wavelengths_nm, table_nm, angle_deg, reflectance, transmittance, name=name
    )
    return tables_over_angle(angle_deg, back, through)


def measured_at_channels(
    wavelengths_nm: ArrayLike,
    table_nm: ArrayLike,
    angle_deg: ArrayLike,
    reflectance: ArrayLike,
    transmittance: ArrayLike,
    *,
    name: str = "",
) -> tuple[F64, F64]:
    """(n_channels, a) R and T of a measured coating at the wavelengths of the channels.

    Parameters and errors as of `tabulated_coating`.
    """
    channels = np.atleast_1d(np.asarray(wavelengths_nm, np.float64))
    wavelengths, angles = np.asarray(table_nm, np.float64), np.asarray(angle_deg, np.float64)
    r, t = np.asarray(reflectance, np.float64), np.asarray(transmittance, np.float64)
    shape = (wavelengths.size, angles.size)
    if r.shape != shape or t.shape != shape:
        raise SceneError(
            f"surface {name!r}: a coating table of {shape[0]} wavelengths and {shape[1]} angles "
            f"needs R and T of that shape, got {r.shape} and {t.shape}"
        )
    if np.any(np.diff(wavelengths) <= 0.0) or np.any(np.diff(angles) <= 0.0):
        raise SceneError(f"surface {name!r}: wavelengths and angles of a coating must rise")
    if angles[0] < 0.0 or angles[-1] > 90.0:
        raise SceneError(f"surface {name!r}: angles of a coating lie within 0 and 90 degrees")
    outside = (channels < wavelengths[0]) | (channels > wavelengths[-1])
    if np.any(outside):
        raise SceneError(
            f"surface {name!r}: its coating is given from {wavelengths[0]:g} to "
            f"{wavelengths[-1]:g} nm, the trace needs it at {channels[outside][0]:g} nm"
        )
    total = r + t
    if not (np.all(r >= 0.0) and np.all(t >= 0.0) and np.all(total <= 1.0 + 1e-9)):
        row, column = np.unravel_index(int(np.argmax(total)), shape)
        raise SceneError(
            f"surface {name!r}: its coating creates energy: R + T = {total[row, column]:.4g} at "
            f"{wavelengths[row]:g} nm and {angles[column]:g} degrees"
            if total.max() > 1.0
            else f"surface {name!r}: R and T of a coating must not be negative"
        )
    back, through = (
        np.array([[np.interp(nm, wavelengths, column) for column in values.T] for nm in channels])
        for values in (r, t)
    )
    return back, through


def tables_over_angle(
    angle_deg: ArrayLike, reflectance: ArrayLike, transmittance: ArrayLike
) -> F64:
    """Tables of shares over the angle on the rarer side.

    Parameters
    ----------
    angle_deg : (a,) rising [deg]
    reflectance, transmittance : (n_channels, a)
    """
    r, t = np.asarray(reflectance, np.float64), np.asarray(transmittance, np.float64)
    angles = np.asarray(angle_deg, np.float64)
    x_deg = np.degrees(np.arccos(np.linspace(0.0, 1.0, COATING_ANGLES)))
    table = np.ones((len(r), COATING_SIZE))
    for channel in range(len(r)):
        for values, columns in ((r, (0, 1)), (t, (2,))):
            row_values = np.interp(x_deg, angles, values[channel])
            for part in columns:
                table[channel, part * COATING_ANGLES : (part + 1) * COATING_ANGLES] = row_values
    return table
