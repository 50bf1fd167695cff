"""The example of the format page: ``python -m tests.raymap.format_example`` prints it.

A stream that is compressed may have other bytes with another release of zstandard, which are as
good: the test reads the page's bytes, it does not compare them.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import raymap
from raymap.bytes.chunks import MapFile


def directory():
    """A lamp and a mirror with one face, the plane z = 0."""
    plane = raymap.Quadric(coefficients=(0.0,) * 8 + (1.0, 0.0), solve_axis=2)
    face = raymap.Face(name="top", quadrics=(plane,))
    return raymap.Directory(
        sources=(raymap.Source(name="lamp", flux=2.0),),
        objects=(raymap.SceneObject(name="mirror", faces=(face,)),),
    )


def lines():
    """The first bytes of the map with what they mean."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "example.raymap"
        with raymap.RayMapWriter.create(path, directory()):
            pass
        data = path.read_bytes()
        file = MapFile(path)
        header = file.chunk_at(16, len(data)).header
        file.close()
    found, place = [], 0

    def line(size, words):
        nonlocal place
        content = data[place : place + size]
        kept = content.rstrip(b"\0")
        zeros = f"{size - len(kept)}×00" if size - len(kept) > 8 else None
        text = " ".join(f"{byte:02X}" for byte in (kept if zeros else content))
        found.append(f"{place:04X}  {text} {zeros or ''}".rstrip() + f"    {words}")
        place += size

    line(12, "magic")
    line(4, "version 2.0")
    line(8, "tag RMAP:DIR")
    line(8, f"chunk version 1, {len(header.streams)} streams, no meta block")
    line(8, f"chunk_size {header.size}")
    line(8, "checksum of the 24 bytes before it and of the table")
    for entry in header.streams:
        line(32, f"name {entry.name}")
        line(
            8,
            f"kind {entry.kind}, codec {entry.codec}, plane {entry.plane}, scope {entry.scope}, "
            f"width {entry.width}",
        )
        line(16, f"raw_size {entry.raw_size}, stored_size {entry.stored_size}")
        line(8, "hash")
    for entry in header.streams:
        content = data[place : place + entry.stored_size]
        words = content.decode() if entry.kind == 0 else "codec " + ["0", "1", "2"][entry.codec]
        line(entry.stored_size, f"{entry.name}: {words}")
    return found


def bytes_of(page):
    """The bytes that the page shows."""
    data = b""
    for row in re.findall(r"^([0-9A-F]{4})  (.*?)(?:    .*)?$", page, re.MULTILINE):
        assert int(row[0], 16) == len(data)
        for token in row[1].split():
            count, _, zero = token.rpartition("×")
            data += bytes([int(zero, 16)]) * int(count or 1)
    return data


if __name__ == "__main__":
    print("\n".join(lines()))
