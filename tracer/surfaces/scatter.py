"""Scatter about the specular direction of mirrors and smooth interfaces."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import SerializationInfo, model_serializer, model_validator

from raymap.laws.radial import RADIAL_REACH, RadialScatter, radial_table
from tracer.compiled import S_SCATTER, S_STRIDE
from tracer.description.fields import Node, Positive
from tracer.surfaces.scatter_laws.law import SCATTER_LAWS
from tracer.surfaces.surface import SurfaceRow

__all__ = ["Scatter"]

_FIRST_LAWS = ("abg", "harvey_shack")
"""Laws that scenes of all times have in their fingerprints, and maps know by name."""

_STATED = 257
"""Distances at which a map states a law that it does not know by name."""


class Scatter(Node):
    """Scatter about the specular direction: a law by its word, with its numbers.

    ``abg = [A, B, g]``, ``harvey_shack = [b, width, s]``, or a law that is installed beside. With
    ``reference_nm`` it is scaled from that wavelength to each channel's.
    """

    law: str
    numbers: tuple[float, ...]
    reference_nm: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_law(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "law" in data:
            return data
        words = [key for key in data if key != "reference_nm"]
        for word in words:
            if word not in SCATTER_LAWS:
                raise ValueError(f"there is no law of scatter {word!r}{SCATTER_LAWS.nearest(word)}")
        given = [word for word in words if data[word] is not None]
        known = " or ".join(
            f"{word} = [{', '.join(law.parameters)}]" for word, law in SCATTER_LAWS.items()
        )
        if len(given) != 1:
            raise ValueError(f"give either {known}")
        law, numbers = SCATTER_LAWS[given[0]], data[given[0]]
        wanted = f"{law.word} = [{', '.join(law.parameters)}]"
        if not isinstance(numbers, list | tuple) or len(numbers) != len(law.parameters):
            raise ValueError(f"write {wanted}, a list of {len(law.parameters)} numbers")
        for number in numbers:
            if isinstance(number, bool) or not isinstance(number, int | float):
                raise ValueError(f"{number!r} in {wanted} is no number")
            if not math.isfinite(number):
                raise ValueError(f"{number} in {wanted} is not finite")
        kept = {key: value for key, value in data.items() if key == "reference_nm"}
        return kept | {"law": law.word, "numbers": tuple(numbers)}

    @model_serializer(mode="plain")
    def _by_word(self, info: SerializationInfo) -> dict[str, Any]:
        written: dict[str, Any] = {} if info.exclude_unset else dict.fromkeys(_FIRST_LAWS)
        written[self.law] = list(self.numbers)
        if self.reference_nm is not None or not info.exclude_unset:
            written["reference_nm"] = self.reference_nm
        return written

    def stated(self) -> RadialScatter | None:
        """As maps store it: by its numbers, or over rho where maps do not know the law.

        None of a law that maps do not know and that changes with the wavelength.
        """
        reference = self.reference_nm or 0.0
        if self.law in _FIRST_LAWS:
            said: dict[str, Any] = {self.law: self.numbers, "reference_nm": reference}
            return RadialScatter(**said)
        if reference:
            return None
        rho = np.geomspace(1e-6 * RADIAL_REACH, RADIAL_REACH, _STATED)
        bsdf: Any = SCATTER_LAWS[self.law].bsdf(*self.numbers, wavelength_nm=0.0, reference_nm=0.0)
        return RadialScatter(rho=tuple(rho.tolist()), value=tuple(bsdf(rho).tolist()))

    def compile(self, row: SurfaceRow) -> None:
        """Tables of the law into the pool: one for all channels, or one each.

        Raises
        ------
        SceneError
        """
        reference = self.reference_nm or 0.0
        wavelengths = row.wavelengths_nm if self.reference_nm else row.wavelengths_nm[:1]
        law = SCATTER_LAWS[self.law]
        tables = []
        for wavelength in wavelengths:
            at = float(wavelength) if reference else 0.0
            bsdf: Any = law.bsdf(*self.numbers, wavelength_nm=at, reference_nm=reference)
            tables.append(radial_table(bsdf, name=row.name))
        row.integers[S_SCATTER] = row.pool.add(np.concatenate(tables))
        row.integers[S_STRIDE] = len(tables[0]) if reference else 0
