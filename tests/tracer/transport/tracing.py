"""Helpers of the engine's tests: small scenes from text, rays of a portion as lists of points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from raymap.model.events import Event
from raymap.model.portion import Portion
from tracer.scene.compile import Compilation, compile_scene
from tracer.scene.load import parse_scene
from tracer.transport.wavefront import Wavefront

HEAD = 'length_unit = "mm"\n'


def compiled(text: str, variants: tuple[str, ...] = ()) -> Compilation:
    """Compile a scene from its text, millimetres understood."""
    return compile_scene(parse_scene(HEAD + text, variants=variants))


@dataclass(frozen=True, eq=False)
class Trace:
    """A traced portion with the questions that tests ask."""

    compilation: Compilation
    portion: Portion

    @cached_property
    def offsets(self) -> NDArray[np.int64]:
        return np.concatenate(([0], np.cumsum(self.portion.records_per_ray, dtype=np.int64)))

    @property
    def last(self) -> NDArray[np.int64]:
        """Record at which each ray ends."""
        return self.offsets[1:] - 1

    def endings(self, event: Event) -> int:
        """How many rays end with an event."""
        return int(np.count_nonzero(self.portion.event[self.last] & int(event)))

    def ended_on(self, name: str) -> int:
        """How many rays end on an object."""
        return int(np.count_nonzero(self.portion.object[self.last] == self.object(name)))

    def object(self, name: str) -> int:
        return [item.name for item in self.compilation.directory.objects].index(name)

    def count(self, event: Event) -> int:
        """How many records carry an event."""
        return int(np.count_nonzero(self.portion.event & int(event)))


def trace(text: str | Compilation, n_rays: int, *, seed: int = 1, first: int = 0, block: int = 4096) -> Trace:  # fmt: skip # noqa: E501
    """Trace rays of a scene."""
    compilation = compiled(text) if isinstance(text, str) else text
    engine = Wavefront(compilation.arrays, seed, meshes=compilation.solids, block=block)
    return Trace(compilation, engine.trace(first, n_rays))


def assert_share(count: int, total: int, expected: float, *, sigmas: float = 4.5) -> None:
    """A count of independent trials agrees with a probability."""
    spread = np.sqrt(expected * (1.0 - expected) / total)
    assert abs(count / total - expected) <= sigmas * spread + 1e-12, (count / total, expected)
