"""Media in the scene description."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from pydantic import (
    SerializationInfo,
    SerializeAsAny,
    SerializerFunctionWrapHandler,
    create_model,
    field_validator,
    model_serializer,
)

from tracer.description.fields import Node, Positive, Share, Spectral
from tracer.media.keys.key import MEDIUM_KEYS
from tracer.media.phases.isotropic import Isotropic
from tracer.media.phases.phase import PHASES, Phase

__all__ = ["MediumModel", "Scattering", "medium_class", "medium_model"]

_FIRST_KEYS = ("index", "sellmeier", "cauchy", "glass", "absorption")
"""Keys that every medium once had; scenes keep the fingerprints of that time."""


class Scattering(Node):
    """Volume scattering: mean free path of scattering [scene unit] or its coefficient."""

    mean_free_path: Positive | None = None
    coefficient: Spectral | None = None
    albedo: Share | None = None
    phase: SerializeAsAny[Phase] = Isotropic(kind="isotropic")

    @field_validator("phase", mode="before")
    @classmethod
    def _of_its_kind(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        kind = data.get("kind")
        if kind is None:
            raise ValueError(f"kind is missing; one of {', '.join(PHASES)}")
        if not isinstance(kind, str) or kind not in PHASES:
            raise ValueError(f"there is no phase function {kind!r}{PHASES.nearest(str(kind))}")
        model = PHASES[kind]
        for name in data:
            if name not in model.model_fields:
                keys = ", ".join(key for key in model.model_fields if key != "kind")
                takes = keys or "no other keys"
                raise ValueError(f"the {kind} phase function has no {name}; it takes {takes}")
        return model.model_validate(dict(data))

    def model_post_init(self, context: Any) -> None:
        if (self.mean_free_path is None) == (self.coefficient is None):
            raise ValueError("give either mean_free_path or coefficient")


class MediumModel(Node):
    """A medium: one key that says its index, others as it has them, and how it scatters.

    Its keys are a registry (`tracer.media.keys.key.MEDIUM_KEYS`), so that a class is made for the
    keys that a medium has (`medium_class`).

    With ``albedo`` the free path of ``scattering`` counts scattering and absorption together.
    """

    scattering: Scattering | None = None

    def model_post_init(self, context: Any) -> None:
        keys = [MEDIUM_KEYS[word] for word in self.given]
        if sum(key.index is not None for key in keys) != 1:
            *most, last = (key.word for key in MEDIUM_KEYS.kinds() if key.index is not None)
            raise ValueError(f"give exactly one of {', '.join(most)} or {last}")
        absorbing = [key.word for key in keys if key.index is None and key.absorption is not None]
        if len(absorbing) > 1:
            raise ValueError(f"give either {' or '.join(absorbing)}: each says the absorption")
        for key in keys:
            if key.alone and (len(keys) > 1 or self.scattering is not None):
                raise ValueError(key.alone)

    @property
    def given(self) -> dict[str, Any]:
        """The keys of the registry that it has, with their values."""
        found = ((name, getattr(self, name)) for name in type(self).model_fields)
        return {name: value for name, value in found if name != "scattering" and value is not None}

    def key(self, word: str) -> Any:
        """What a key says; None where the medium does not have it."""
        return getattr(self, word, None) if word in type(self).model_fields else None

    @property
    def formula(self) -> str:
        """The key that says the index."""
        return next(word for word in self.given if MEDIUM_KEYS[word].index is not None)

    @property
    def splits(self) -> bool:
        """Whether light in it splits in two."""
        return MEDIUM_KEYS[self.formula].splits

    @model_serializer(mode="wrap")
    def _with_first_keys(
        self, handler: SerializerFunctionWrapHandler, info: SerializationInfo
    ) -> dict[str, Any]:
        given: dict[str, Any] = handler(self)
        return given if info.exclude_unset else dict.fromkeys(_FIRST_KEYS) | given

    def __reduce__(self) -> tuple[Any, ...]:
        # Classes that are made cannot be found by their name where a pickle is read
        return medium_model, ({name: getattr(self, name) for name in self.model_fields_set},)


def medium_class(words: Mapping[str, Any] | frozenset[str]) -> type[MediumModel]:
    """The class of media that have these keys; those that no kind has are refused by it."""
    return _medium_class(frozenset(word for word in words if word in MEDIUM_KEYS))


@cache
def _medium_class(words: frozenset[str]) -> type[MediumModel]:
    fields: dict[str, Any] = {
        word: (MEDIUM_KEYS[word].value | None, None) for word in sorted(words)
    }
    return create_model("MediumModel", __base__=MediumModel, **fields)


def medium_model(given: Mapping[str, Any]) -> MediumModel:
    """A medium of its keys.

    Raises
    ------
    pydantic.ValidationError
    """
    return medium_class(given).model_validate(dict(given))
