"""Small lens files for tests: a singlet in the words of Zemax and of CODE V."""

from __future__ import annotations

import warnings
from pathlib import Path

from tracer.importers.lens_scene import ImportedLens, import_lens
from tracer.importers.prescription import ImportWarning

__all__ = ["codev", "messages", "opened", "zemax"]


def zemax(*surfaces: str, head: str = "", epd: float = 10.0) -> str:
    """A Zemax file: each surface is its lines, separated by ``;``; object and image are added."""
    lines = ["MODE SEQ", "UNIT MM", f"ENPD {epd:g}", "WAVM 1 0.5875618 1", "PWAV 1"]
    lines += [line for line in head.split("\n") if line]
    if "FTYP" not in head:
        lines += ["FTYP 0 0 1 1", "XFLN 0", "YFLN 0"]
    for number, surface in enumerate(["DISZ INFINITY", *surfaces]):
        lines.append(f"SURF {number}")
        lines += [f"  {line.strip()}" for line in surface.split(";")]
    return "\n".join(lines) + "\n"


def codev(body: str, head: str = "RDM;LEN", fields: str = "YAN 0") -> str:
    """A CODE V file: what stands between SO and GO, for 587.6 nm and a beam of 10 mm."""
    return f"{head}\nEPD 10\nDIM M\nWL 587.6\nREF 1\n{fields}\nSO 0 1e13\n{body}\nGO\n"


def opened(folder: Path, text: str, suffix: str = ".zmx") -> tuple[ImportedLens, list[str]]:
    """A text as a lens whose scene was made, and what was warned of."""
    path = folder / f"lens{suffix}"
    path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        lens = import_lens(path)
        lens.scene_tables()
    return lens, messages(caught)


def messages(caught: list[warnings.WarningMessage]) -> list[str]:
    """Texts of the warnings of imports; any other warning stays an error."""
    for item in caught:
        assert issubclass(item.category, ImportWarning), item.message
    return [str(item.message) for item in caught]
