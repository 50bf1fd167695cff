"""A folder with the samples, in which what the pages say is tried."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the pages' commands run one after the other."""
    folder = tmp_path_factory.mktemp("pages")
    shutil.copytree(ROOT / "samples", folder / "samples")
    ghost = (ROOT / "docs" / "find_the_ghost.md").read_text(encoding="utf-8")
    scene = (ROOT / "samples" / "double_gauss.toml").read_text(encoding="utf-8")
    [addition] = re.findall(r"```toml\n(.*?)```", ghost, re.S)
    (folder / "pair.toml").write_text(scene + "\n" + addition, encoding="utf-8")
    return folder
