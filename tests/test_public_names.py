"""The public names of the packages: each is there, and none hides behind a module."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

_ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("raymap", "raymap.rayfiles", "tracer", "query", "viewer", "service")


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there_once(package: str) -> None:
    module = import_module(package)
    assert len(set(module.__all__)) == len(module.__all__)
    for name in module.__all__:
        assert getattr(module, name) is not None


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_takes_the_place_of_a_public_name(package: str) -> None:
    # Whoever imports the module first would find it where the function is expected
    for name in import_module(package).__all__:
        assert find_spec(f"{package}.{name}") is None, name


def test_names_do_not_depend_on_the_order_in_which_they_are_asked_for() -> None:
    code = "import query; query.write_ray_file; assert callable(query.rays_at)"
    subprocess.run([sys.executable, "-c", code], cwd=_ROOT, check=True)
