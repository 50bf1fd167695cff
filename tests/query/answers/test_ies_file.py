"""Far fields as IES files: read back, they are the same light."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from query.answers.images.image_files import write_image
from raymap import RayMapError
from tests.far_fields import far_field
from tracer.light import read_light


def lobe(gamma: Any, c: Any) -> Any:
    """A lobe that leans towards C = 30°; even around its axis where that has but one cell."""
    tilt = 0.5 * np.sin(gamma) * np.cos(c - np.radians(30.0)) if np.size(c) > 1 else 0.0
    return 100.0 * np.cos(gamma / 2.0) ** 4 * (1.0 + tilt)


@pytest.mark.parametrize(("cells", "last"), [((72, 90), 180.0), ((72, 45), 90.0), ((1, 60), 120.0)])
def test_the_light_of_a_file_is_that_of_the_far_field(
    cells: tuple[int, int], last: float, tmp_path: Path
) -> None:
    image = far_field(lobe, cells, last, angles="type_c")
    path = write_image(image, tmp_path / "lamp.ies")
    light = read_light(path)
    assert light.flux == pytest.approx(image.total, rel=5e-3)
    gamma = np.array([0.0, 10.0, 47.0, 80.0])
    for c in (0.0, 30.0, 117.0, 300.0):
        around = np.radians([c, c]) if cells[0] > 1 else np.zeros(1)
        expected = lobe(np.radians(gamma)[:, None], around)[:, 0]
        np.testing.assert_allclose(light.at(gamma, np.full(4, c)), expected, rtol=0.01)
    assert max(map(len, path.read_text("ascii").splitlines())) < 256


@pytest.mark.parametrize(
    "other", [{"angles": "theta_phi"}, {"angles": "type_c", "gamma_deg": (10.0, 90.0)}]
)
def test_other_angles_are_refused(other: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(RayMapError, match="C planes and gamma from 0 on"):
        write_image(far_field(lobe, (8, 4), **other), tmp_path / "lamp.ies")
    assert not list(tmp_path.iterdir())


def test_a_plane_has_no_intensity(maps: dict[str, Any], tmp_path: Path) -> None:
    import query

    picture = query.detector_image(maps["merged"], "screen")
    with pytest.raises(RayMapError, match="'screen' is of kind plane"):
        write_image(picture, tmp_path / "lamp.ies")
