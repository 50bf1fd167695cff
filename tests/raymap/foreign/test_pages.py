"""The examples of the pages about other programs' files run as they stand there."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import raymap

DOCS = Path(__file__).parents[3] / "docs"
PAGES = ("photometry", "ray_files", "other_tracers", "export_3d")


def blocks(page: str, kind: str) -> list[str]:
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    return re.findall(rf"```{kind}\n(.*?)```", text, flags=re.DOTALL)


def test_the_recorders_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (example,) = [text for text in blocks("other_tracers", "python") if "RayRecorder" in text]
    exec(compile(example, "other_tracers.md", "exec"), {})
    with raymap.open("mine.raymap") as ray_map:
        assert (ray_map.rays, ray_map.records) == (1, 3)


@pytest.mark.parametrize("page", PAGES)
def test_pages(page: str) -> None:
    from raymap.cli import application

    for text in blocks(page, "toml"):
        assert tomllib.loads(text)
    for text in blocks(page, "python"):
        compile(text, page, "exec")
    commands = {command.name for command in application().registered_commands}
    used = re.findall(r"^\$ raymap ([\w-]+)", "\n".join(blocks(page, "console")), flags=re.M)
    assert set(used) <= commands
