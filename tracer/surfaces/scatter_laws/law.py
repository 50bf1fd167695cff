"""What a law of scatter is, and those that there are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from raymap.model.registry import Registry

__all__ = ["SCATTER_LAWS", "ScatterLaw"]


@dataclass(frozen=True, kw_only=True)
class ScatterLaw:
    """A BSDF that depends only on ``rho`` = |beta - beta_0| (`raymap.laws.radial`).

    Attributes
    ----------
    word : of the scene file, for a list of numbers
    parameters : their names, in order
    title : the law as it is written
    bsdf : takes the numbers in this order, and the wavelength and the one for
        which they hold [nm] as ``wavelength_nm`` and ``reference_nm`` (0: the same for all); gives
        the BSDF [1/sr] as a function of an array of rho

    Laws are stored as tables over rho: what a law says between rho = 0 and 2 is all that it is.
    """

    word: str
    parameters: tuple[str, ...]
    title: str
    bsdf: Callable[..., Callable[..., object]]

    def spelling(self) -> str:
        """How it is written in a scene."""
        return f"{self.word} = [{', '.join(self.parameters)}]"


SCATTER_LAWS: Registry[ScatterLaw] = Registry(
    "tracer.scatter_laws",
    "tracer.surfaces.scatter_laws",
    words=lambda law: (law.word,),
    of=ScatterLaw,
    sort="laws of scatter about the specular direction",
)
