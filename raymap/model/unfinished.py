"""What is said of a kind that leaves out what every kind of its sort must say."""

from __future__ import annotations

from importlib.metadata import distributions

from raymap.model.errors import RayMapError

__all__ = ["Unfinished"]


class Unfinished(RayMapError, NotImplementedError):
    """A kind, mostly one of another distribution, does not say a method of its own.

    Parameters
    ----------
    kind : an object of the kind
    method : that it must say
    """

    def __init__(self, kind: object, method: str) -> None:
        made = type(kind)
        owner = _distribution(made.__module__)
        whose = f" of the distribution {owner!r}" if owner else ""
        remedy = f"upgrade or uninstall {owner}" if owner else "add it"
        super().__init__(
            f"{made.__module__}.{made.__qualname__}{whose} does not say its method {method!r}, "
            f"which every kind of its sort must; {remedy}"
        )


def _distribution(module: str) -> str:
    """The distribution whose entry points name modules of this package; "" where none does."""
    package = module.partition(".")[0]
    for each in distributions():
        if any(point.value.partition(".")[0] == package for point in each.entry_points):
            return str(each.name)
    return ""
