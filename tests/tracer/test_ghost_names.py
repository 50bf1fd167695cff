"""Ghosts of the sample lens: the faces that are named are those at which the light turned back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import raymap
from query.answers.paths.ghosts import ghost_matrix
from query.expression.names import FaceNames
from raymap.model.events import Event
from tracer.run.recording import record
from tracer.scene.load import parse_scene

SAMPLE = Path(__file__).parents[2] / "samples" / "double_gauss.toml"

# Vertex and radius of every face, in the order in which the light meets them
PRESCRIPTION = {
    "L1.front": (0.0, 56.20238), "L1.back": (8.75, 152.28580), "L2.front": (9.25, 37.68262),
    "L2.back = L3.front": (21.75, math.inf), "L3.back": (25.55, 24.23130),
    "L4.front": (55.667402, -28.37731), "L4.back = L5.front": (59.467402, math.inf),
    "L5.back": (70.467402, -37.92546), "L6.front": (70.967402, 177.41176),
    "L6.back": (77.967402, -79.41143),
}  # fmt: skip


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ghosts") / "lens.raymap"
    text = SAMPLE.read_text(encoding="utf-8")
    # Cement reflects far less than air does: let all faces reflect the same
    text = text.replace("[surfaces.glass]", "[surfaces.glass]\nreflectance = 0.05\n#", 1)
    record(parse_scene(text), path, rays=20_000, seed=4)
    return path


def test_named_faces_are_where_the_light_turned_back(path: Path) -> None:
    with raymap.open(path) as lens:
        matrix = ghost_matrix(lens)
        assert set(matrix.labels) <= set(PRESCRIPTION)
        assert "L4.back = L5.front" in matrix.labels
        # The faces by name at which the records of ghosts stand, and the places of these records
        faces = [
            (number, face.name, item.name, face)
            for number, item in enumerate(lens.directory.objects)
            for face in item.faces
        ]
        seen = set()
        for portion in lens.portions:
            mirrored = portion.column("event") & int(Event.SPECULAR_REFLECTION) != 0
            for number, name, owner, face in faces:
                label = " = ".join((f"{owner}.{name}", *face.aliases))
                if label not in PRESCRIPTION:
                    continue
                triangle = portion.column("triangle")
                here = mirrored & (portion.column("object") == number)
                here &= triangle >= face.first_primitive
                here &= triangle < face.first_primitive + face.primitive_count
                vertex, radius = PRESCRIPTION[label]
                x, y, z = portion.column("position")[here].astype(float).T
                r2 = x * x + y * y
                sag = (
                    0.0
                    if math.isinf(radius)
                    else radius - math.copysign(1, radius) * np.sqrt(radius * radius - r2)
                )
                assert np.allclose(z, vertex + sag, atol=2e-5), label
                if here.any():
                    seen.add(label)
        assert seen == set(PRESCRIPTION)


def test_both_names_of_a_cemented_face_ask_for_it(path: Path) -> None:
    with raymap.open(path) as lens:
        from query import select

        names = FaceNames(lens.directory)
        assert {"L4.back", "L5.front"} <= set(names.full_names)
        one = select(lens, 'hit("L4.back", reflected)')
        two = select(lens, 'hit("L5.front", reflected)')
        assert one.matched == two.matched > 0
        for pair in ghost_matrix(lens).pairs(3):
            assert select(lens, pair["criterion"]).matched == pair["rays"]
