"""The PyVista view holds the same rays and bodies as the painted picture."""

from __future__ import annotations

import numpy as np
import pytest

import raymap
from raymap.model.errors import RayMapError
from viewer import picture, plotter

pytest.importorskip("pyvista")

GHOST = 'count(hit("L1", reflected)) == 2'


def test_all_rays_are_one_mesh_with_their_numbers(small_map: raymap.RayMap) -> None:
    view = plotter(small_map, GHOST, rays=50, off_screen=True, window_size=(320, 200))
    try:
        assert {"L1", "tube", "sensor", "rays"} <= set(view.actors)
        mesh = view.actors["rays"].mapper.dataset
        drawn = np.unique(mesh.cell_data["ray_id"])
        assert 0 < len(drawn) <= 50
        for ray_id in drawn[:5].tolist():
            portion, ray = small_map.find_ray(ray_id)
            stored = small_map.portions[portion]
            first, last = stored.record_offsets()[ray : ray + 2]
            places = stored.column("position")[first:last]
            segments = mesh.points.reshape(-1, 2, 3)[mesh.cell_data["ray_id"] == ray_id]
            np.testing.assert_array_equal(segments[:, 0], places[:-1])
            np.testing.assert_array_equal(segments[:, 1], places[1:])
    finally:
        view.close()


def test_it_renders_what_the_painter_paints(small_map: raymap.RayMap) -> None:
    view = plotter(small_map, GHOST, rays=50, off_screen=True, window_size=(320, 200))
    try:
        rendered = np.asarray(view.screenshot(None, return_img=True))[..., :3]
    finally:
        view.close()
    painted = picture(small_map, GHOST, rays=50, size=(320, 200), legend=False)
    covered = [
        np.abs(image - image[0, 0].astype(int)).sum(axis=2) > 60 for image in (rendered, painted)
    ]
    # Bodies and rays stand in the same part of both pictures
    both = (covered[0] & covered[1]).sum()
    assert both > 0.5 * min(covered[0].sum(), covered[1].sum()) > 100


def test_an_unknown_color_rule_is_refused(small_map: raymap.RayMap) -> None:
    with pytest.raises(RayMapError, match="no colour rule 'rainbow'"):
        plotter(small_map, color="rainbow")
