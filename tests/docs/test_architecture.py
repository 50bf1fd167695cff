"""The page of rooms is true: its picture is that of the contracts, and its rooms are there."""

from __future__ import annotations

import re
import runpy

from tests.docs.blocks import ROOT

DRAWN = runpy.run_path(str(ROOT / "docs" / "architecture_picture.py"))
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_picture_is_that_of_the_contracts() -> None:
    assert DRAWN["PICTURE"].read_text(encoding="utf-8") == DRAWN["picture"](), (
        "run python docs/architecture_picture.py"
    )


def test_every_room_of_the_contracts_is_on_the_page() -> None:
    for package, layers in DRAWN["layers"]().items():
        [row] = [line for line in PAGE.splitlines() if line.startswith(f"| `{package}/` | `")]
        said = set(re.findall(r"`(\w+)`", row))
        assert {room for layer in layers for room in layer} <= said, package


def test_every_file_that_it_names_is_there() -> None:
    for name in re.findall(r"`((?:raymap|tracer|query|viewer|service)/[\w/]+\.py)`", PAGE):
        assert (ROOT / name).is_file(), name
