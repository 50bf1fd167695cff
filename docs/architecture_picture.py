"""The picture of the house: ``python docs/architecture_picture.py`` writes images/architecture.svg.

Rooms stand as the contracts of imports in pyproject.toml order them, highest first.
"""

from __future__ import annotations

import tomllib
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
PACKAGES = ("service", "viewer", "query", "tracer", "raymap")
WIDTH, LINE, GAP, HEAD = 140, 20, 12, 34
LEFT_OUT = {"__main__", "registries", "rooms"}
"""Single modules that say nothing about the house."""


def layers() -> dict[str, list[list[str]]]:
    """Of each package its layers from the top, with the rooms of each."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    found = {}
    for contract in contracts["tool"]["importlinter"]["contracts"]:
        if contract["type"] == "layers":
            [package] = contract["containers"]
            rows = [[room.strip() for room in row.split("|")] for row in contract["layers"]]
            rows = [[room for room in row if room not in LEFT_OUT] for row in rows]
            found[package] = [row for row in rows if row]
    return found


def picture() -> str:
    """The drawing as SVG."""
    house = layers()
    height = HEAD + max(sum(GAP + LINE * len(row) for row in rows) for rows in house.values()) + 30
    width = GAP + (WIDTH + GAP) * len(PACKAGES)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="13">',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
    ]
    for column, package in enumerate(PACKAGES):
        x = GAP + (WIDTH + GAP) * column
        lines.append(
            f'<text x="{x + WIDTH / 2:g}" y="22" text-anchor="middle" font-weight="bold">'
            f"{package}/</text>"
        )
        y = HEAD
        for row in house[package]:
            tall = LINE * len(row)
            lines.append(
                f'<rect x="{x}" y="{y}" width="{WIDTH}" height="{tall}" rx="4" fill="#eef3fa" '
                'stroke="#7d94b5"/>'
            )
            for k, room in enumerate(row):
                lines.append(f'<text x="{x + 10}" y="{y + LINE * k + 14}">{escape(room)}</text>')
            y += tall + GAP
    lines.append(
        f'<text x="{GAP}" y="{height - 10}" fill="#6b7a90">Imports run down within a package; '
        "between them: service to all, viewer to query and raymap, query and tracer to raymap."
        "</text>"
    )
    return "\n".join([*lines, "</svg>"]) + "\n"


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
