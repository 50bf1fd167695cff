"""Filter strings mean what their criteria mean."""

from __future__ import annotations

from typing import Any

import pytest

import query
from query import select
from raymap.model.errors import CriterionError
from raymap.model.events import Event
from tests.naive.rays import rays_of


@pytest.mark.parametrize(
    ("text", "criterion"),
    [
        ("H1", 'hit("L1")'),
        ("M4", '!hit("wall")'),
        ("L5", 'last(hit("eye"))'),
        ("R1 & !T2", 'hit("L1", reflected) & !hit("L2", transmitted)'),
        ("(H1 | S3) ^ O2", '(hit("L1") | hit("mesh\\.a", scattered)) ^ source("sun")'),
        ("G0 & O1", 'hit("*", specular_reflection) & source("lamp")'),
        ("B0", "event(volume_scatter)"),
        ("W2", "wavelength == 550 nm"),
        ("X_HITFACE(1, 2)", 'hit("L1.back")'),
        ("X_HITFACE2(1,1,2)", 'count(hit("L1.front")) == 2'),
        ("X_HITFACE(1,0)", 'hit("L1.rim")'),
        ("X_GHOST(1, 1)", 'count(hit("L1", specular_reflection)) == 1'),
        ("H1&H2|H3", 'hit("L1") & hit("L2") | hit("mesh\\.a")'),
    ],
)
def test_filter_strings(text: str, criterion: str, maps: dict[str, Any]) -> None:
    assert query.translate(text, maps["merged"]) == query.parse(criterion)


def test_filter_strings_of_volumes_and_paths(maps: dict[str, Any]) -> None:
    map = maps["merged"]
    inside = query.translate("B1", map)
    expected = []
    for ray in rays_of(map):
        last = -1
        hit = False
        for point in ray.points[1:]:
            hit |= bool(point.event & int(Event.VOLUME_SCATTER)) and last == 0
            last = point.object if point.object >= 0 else last
        if hit:
            expected.append(ray.id)
    assert set(select(map, inside).ray_ids.tolist()) <= set(expected)
    strongest = query.path_table(map, by="object").rows(1)[0]
    assert select(map, query.translate("_1", map)).matched == strongest.rays


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("D3", "D3 cannot be translated: diffraction"),
        ("H1 & E2", "E2 cannot be translated"),
        ("J1", "J1 cannot be translated"),
        ("X_WAVERANGE(1,2)", "X_WAVERANGE cannot be translated"),
        ("H9", "there is no object 9"),
        ("O7", "there is no source 7"),
        ("W9", "there is no channel 9"),
        ("_999", "there is no path 999"),
        ("X_HITFACE(1,9)", "has no face 9"),
        ("X_HITFACE2(1,2)", "takes 3 whole numbers"),
        ("H1 &", "ends too early"),
        ("(H1", "never closed"),
        ("H1)", "closes nothing"),
        ("h1", "no filter flag"),
        ("", "ends too early"),
        ("(" * 500 + "H1" + ")" * 500, "deeper"),
    ],
)
def test_filter_strings_that_cannot_be_translated(
    text: str, message: str, maps: dict[str, Any]
) -> None:
    with pytest.raises(CriterionError, match=message):
        query.translate(text, maps["merged"])
