"""Versions, our packages and what hides them, plug-ins, extras."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib.machinery import PathFinder
from importlib.metadata import (
    Distribution,
    PackageNotFoundError,
    distributions,
    packages_distributions,
    requires,
    version,
)
from importlib.util import find_spec
from pathlib import Path

from raymap.examination.finding import Finding
from raymap.model.errors import RayMapError
from raymap.model.extras import EXTRAS
from raymap.model.parts import OURS
from raymap.rooms import ROOMS, check_room, home, registries

__all__ = ["extras", "names", "plugins", "versions"]


def versions() -> Iterator[Finding]:
    """Of Python, of Raymap and of what it needs."""
    part = "versions"
    yield Finding(part, f"Python {sys.version.split()[0]} at {sys.executable}")
    ours = [found for found in distributions() if found.name == OURS]
    stated = {found.version: _place(found) for found in ours}
    if len(stated) > 1:
        shown = ", ".join(f"{number} in {place}" for number, place in stated.items())
        yield Finding(
            part,
            f"raymap: {shown}",
            f"two installations of raymap are on Python's path: {shown}",
            "pip uninstall raymap until none is left, then install one",
        )
    for number, place in list(stated.items())[:1]:
        yield Finding(part, f"raymap {number}, described in {place}")
    if not stated:
        yield Finding(
            part,
            "raymap is not installed",
            "no metadata of raymap is installed: commands and kinds of its rooms are not found",
            "pip install raymap, or pip install -e . in the folder of the sources",
        )
    for requirement in _requirements():
        yield _requirement(part, requirement, needed=True)


def _place(distribution: Distribution) -> str:
    return str(Path(str(distribution.locate_file(""))).resolve())


def _requirements(extra: str = "") -> list[str]:
    """What raymap needs, or what an extra of it brings."""
    try:
        stated = requires(OURS) or []
    except PackageNotFoundError:
        return []
    found = []
    for text in stated:
        requirement, _, marker = text.partition(";")
        of_extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", marker)
        if (of_extra.group(1) if of_extra else "") == extra:
            found.append(requirement.strip())
    return found


def _requirement(part: str, requirement: str, *, needed: bool) -> Finding:
    """One package: its version, and whether it fits."""
    name = re.split(r"[\s\[<>=!~;(]", requirement, maxsplit=1)[0]
    try:
        found = version(name)
    except PackageNotFoundError:
        if not needed:
            return Finding(part, f"{name} is not installed")
        return Finding(
            part,
            f"{name} is not installed",
            f"raymap needs {requirement}, which is not installed",
            f"pip install '{requirement}'",
        )
    bounds = re.findall(r"(>=|<)\s*([\d.]+)", requirement.split("]")[-1])
    own = _numbers(found)
    compare = {">=": own.__ge__, "<": own.__lt__}
    if all(compare[operator](_numbers(bound)) for operator, bound in bounds):
        return Finding(part, f"{name} {found}")
    return Finding(
        part, f"{name} {found}", f"raymap wants {requirement}, and {found} is installed",
        f"pip install '{requirement}'",
    )  # fmt: skip


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", text.split("+")[0])[:3])


def names() -> Iterator[Finding]:
    """Where each of our packages lies, and what else has its name."""
    part = "packages"
    owners = packages_distributions()
    for room in ROOMS:
        own = home() / room
        if not (own / "__init__.py").exists():
            yield Finding(part, f"{room} is not installed")
            continue
        try:
            check_room(room)
        except RayMapError as error:
            yield Finding(
                part, f"{room} is hidden", str(error).partition(": rename")[0],
                "rename the file, or take its folder off Python's path (PYTHONPATH, the current "
                "folder)",
            )  # fmt: skip
            continue
        yield Finding(part, f"{room} from {own}")
        for folder in _others(room):
            whose = sorted(set(owners.get(room, ())) - {OURS})
            of = f" of the distribution {', '.join(whose)}" if whose else ""
            yield Finding(
                part,
                f"{room} also at {folder}",
                f"{folder}{of} has the import name {room!r} of Raymap: which of the two Python "
                "takes depends on its path",
                f"uninstall {', '.join(whose)}, or keep the two in environments of their own"
                if whose
                else "rename it, or start Python elsewhere",
            )
        if len(set(owners.get(room, ()))) > 1 and not list(_others(room)):
            whose = sorted(set(owners[room]) - {OURS})
            yield Finding(
                part,
                f"{room} is shared with {', '.join(whose)}",
                f"the distribution {', '.join(whose)} installs into the package {room!r} of Raymap",
                f"uninstall {', '.join(whose)} and install raymap again (--force-reinstall)",
            )


def _others(room: str) -> Iterator[Path]:
    """Modules of our names on Python's path and in the current folder that are not ours."""
    seen = {(home() / room / "__init__.py").resolve()}
    for folder in (str(Path.cwd()), *sys.path):
        spec = PathFinder.find_spec(room, [folder or "."])
        # A folder without __init__.py hides nothing
        if spec is None or spec.origin is None:
            continue
        found = Path(spec.origin).resolve()
        if found not in seen:
            seen.add(found)
            yield found


def plugins() -> Iterator[Finding]:
    """Kinds of other distributions, and those that cannot be used."""
    part = "plug-ins"
    none = True
    for name, registry in registries().items():
        try:
            entries = registry.entries()
        except RayMapError as error:
            none = False
            message, _, remedy = str(error).rpartition("; ")
            yield Finding(part, f"{name}: broken", message or str(error), remedy)
            continue
        for entry in entries:
            if entry.distribution not in ("", OURS):
                none = False
                yield Finding(part, f"{name}: {entry.word} of {entry.distribution}")
    if none:
        yield Finding(part, "none")


def extras() -> Iterator[Finding]:
    """Which extras are there, and in which versions."""
    part = "extras"
    for extra, modules in EXTRAS.items():
        needed = _requirements(extra)
        missing = [module for module in modules if find_spec(module) is None]
        if len(missing) == len(modules):
            yield Finding(part, f"{extra}: not installed (pip install 'raymap[{extra}]')")
            continue
        own = [_requirement(part, requirement, needed=False) for requirement in needed]
        found = [item.found for item in own if "not installed" not in item.found]
        gone = [item.found.split()[0] for item in own if "not installed" in item.found]
        left = f"; without {', '.join(gone)} (pip install 'raymap[{extra}]')" if gone else ""
        yield Finding(part, f"{extra}: {', '.join(found) or 'installed'}{left}")
        yield from (item for item in own if item.problem)
