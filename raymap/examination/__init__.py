"""What an installation is, and what is wrong with it: `examine` goes through all parts.

`raymap.examination.packages`  versions, where our packages lie, what hides them, extras, plug-ins
`raymap.examination.machine`   compiled code and its folder, cores, memory, disk, browser
"""

from __future__ import annotations

from raymap.examination.finding import Finding
from raymap.examination.machine import browser, compiled_code, cores, memory
from raymap.examination.packages import extras, names, plugins, versions

__all__ = ["Finding", "examine"]


def examine(*, compiling: bool = True) -> list[Finding]:
    """Every part in turn; a finding with a problem says what to do.

    Parameters
    ----------
    compiling : compile a small function to see that it works
    """
    return [
        *versions(),
        *names(),
        *plugins(),
        *extras(),
        *compiled_code(compiling=compiling),
        *cores(),
        *memory(),
        *browser(),
    ]
