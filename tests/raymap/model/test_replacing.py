"""Files that are written beside their place: whole or not at all, and what is said."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from raymap.model.errors import RayMapError
from raymap.model.replacing import replacing


def test_the_file_stands_there_when_all_went_well(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with replacing(target) as beside:
        beside.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "the disk is full"),
        (OSError("1036800 requested and 2544 written"), "the disk is full"),
        (PermissionError(errno.EACCES, "Permission denied"), "Permission denied"),
    ],
)
def test_a_refusal_names_the_target_and_leaves_it(
    tmp_path: Path, error: OSError, said: str
) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def write() -> None:
        with replacing(target) as outer, replacing(outer) as beside:
            beside.write_text("half")
            raise error

    with pytest.raises(RayMapError) as caught:
        write()
    assert str(caught.value) == f"{target} cannot be written: {said}"
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_other_errors_are_not_changed(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), replacing(tmp_path / "a.txt"):
        raise ZeroDivisionError
    with pytest.raises(RayMapError, match="it is a folder"), replacing(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    place, link = tmp_path / "disk" / "b.txt", tmp_path / "a.txt"
    place.write_text("old")
    link.symlink_to(place)
    with replacing(link) as beside:
        beside.write_text("new")
    assert link.is_symlink()
    assert place.read_text() == "new"


def test_a_device_is_no_file() -> None:
    with pytest.raises(RayMapError, match="it is a device"), replacing(Path("/dev/null")):
        pass
