"""Short cuts of the engine change nothing: the same rays with and without, bit by bit."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from raymap.model.portion import Portion
from tracer.compiled import F_OBJECT, F_TRIANGLE
from tracer.run.warm_up import order_faces
from tracer.scene.compile import compile_scene
from tracer.scene.load import load_scene, parse_scene
from tracer.transport.wavefront import Wavefront

SAMPLE = Path(__file__).parents[3] / "samples" / "double_gauss.toml"


def crowd(seed: int) -> str:
    """Mirrors and glass of all kinds in random places, in part inside each other."""
    rng = np.random.default_rng(seed)
    lines = [
        'length_unit = "mm"',
        "[limits]\ndepth = 40",
        "[media.glass]\nindex = 1.5",
        '[surfaces.clear]\nkind = "dielectric"',
        '[surfaces.wall]\nkind = "lambertian"\nreflectance = 0.9',
        '[sources.lamp]\nkind = "point"',
    ]
    for k in range(14):
        kind = ("sphere", "box", "cylinder", "ring", "lens")[k % 5]
        axis = np.eye(3)[rng.integers(0, 3)] if rng.random() < 0.7 else rng.normal(size=3)
        place = np.round(rng.uniform(-20, 20, 3) * (rng.random(3) < 0.7), 3) + np.array([0, 0, 3])
        lines.append(f"[bodies.b{k}]\nkind = '{kind}'\nposition = {place.tolist()}")
        if kind != "sphere":
            lines.append(f"axis = {np.round(axis, 3).tolist()}")
        size = rng.uniform(1, 6)
        lines.append(
            {
                "sphere": f"radius = {size}\nsurface = 'wall'",
                "box": f"size = [{size}, {2 * size}, {size}]\nsurface = 'wall'",
                "cylinder": f"radius = {size}\nlength = {2 * size}\nsurface = 'wall'\nopen = true",
                "ring": f"inner = {size}\nouter = {size + 3}\nsurface = 'wall'",
                "lens": (
                    f"medium = 'glass'\nsurface = 'clear'\nrim = 'wall'\nthickness = {size}\n"
                    f"front = {{ radius = {4 * size}, semi_diameter = {size} }}\n"
                    f"back = {{ radius = {3 * size}, semi_diameter = {size} }}"
                ),
            }[kind]
        )
    return "\n".join(lines)


@pytest.mark.parametrize("name", ["lens", "flood", "crowd 1", "crowd 2", "crowd 3", "crowd 4"])
def test_decided_hits_are_the_nearest(name: str) -> None:
    if name in ("lens", "flood"):
        scene = load_scene(SAMPLE, variants=("flood",) if name == "flood" else ())
    else:
        scene = parse_scene(crowd(int(name.split()[1])))
    compilation = compile_scene(scene)
    arrays = compilation.arrays
    assert arrays.decides.any()
    undecided = arrays._replace(decides=np.zeros_like(arrays.decides))
    found = Wavefront(arrays, 7).trace(0, 20_000)
    expected = Wavefront(undecided, 7).trace(0, 20_000)
    _assert_same(found, expected)
    # Faces are met whatever the order in which they are tried
    rng = np.random.default_rng(2)
    shape = len(arrays.first) - 1, len(arrays.face_i)
    for met in (rng.integers(0, 1000, shape), rng.integers(0, 2, shape)):
        _assert_same(Wavefront(compilation.ordered(met).arrays, 7).trace(0, 20_000), expected)


def test_faces_are_tried_in_the_order_in_which_rays_meet_them() -> None:
    compilation = compile_scene(load_scene(SAMPLE))
    ordered = order_faces(compilation)
    objects = compilation.directory.objects
    faces = [
        next(
            f"{objects[obj].name}.{face.name}"
            for face in objects[obj].faces
            if 0 <= primitive - face.first_primitive < face.primitive_count
        )
        for obj, primitive in compilation.arrays.face_i[:, [F_OBJECT, F_TRIANGLE]].tolist()
    ]
    chain = (
        "L1.front", "L1.back", "L2.front", "L2.back", "L3.back", "L4.front", "L4.back", "L5.back",
        "L6.front", "L6.back",
    )  # fmt: skip
    for face, following in pairwise(chain):
        start_bin = 2 * faces.index(face) + 1
        target = ordered.arrays.target[start_bin]
        assert target >= 0
        met = ordered.arrays.face[ordered.arrays.first[start_bin] + target]
        assert faces[met] == following
    # Where no ray came by, the list stays as it was
    start, stop = compilation.arrays.first[-2:]
    np.testing.assert_array_equal(
        ordered.arrays.face[start:stop], compilation.arrays.face[start:stop]
    )


@pytest.mark.parametrize("variant", ["", "coated", "spectral", "flood"])
def test_streams_of_rays_are_refracted_as_single_ones(variant: str) -> None:
    scene = load_scene(SAMPLE, variants=(variant,) if variant else ())
    arrays = compile_scene(scene).arrays
    assert arrays.plain.sum() == 10
    one_by_one = arrays._replace(plain=np.zeros_like(arrays.plain))
    expected = Wavefront(one_by_one, 3).trace(0, 30_000)
    _assert_same(Wavefront(arrays, 3).trace(0, 30_000), expected)
    # A stream ends where the most points of a ray are reached
    few = {"limits": arrays.limits.copy()}
    few["limits"][0] = 6
    expected = Wavefront(one_by_one._replace(**few), 3).trace(0, 5_000)
    _assert_same(Wavefront(arrays._replace(**few), 3).trace(0, 5_000), expected)


def _assert_same(found: Portion, expected: Portion) -> None:
    for column in (
        "records_per_ray", "object", "triangle", "event", "position", "normal", "medium",
        "color_code", "color_table",
    ):  # fmt: skip
        np.testing.assert_array_equal(getattr(found, column), getattr(expected, column))
