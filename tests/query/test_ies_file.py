"""Far fields as IES files: read back, they are the same light."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from query import DetectorImage
from query.image_files import write_image
from raymap import ChannelSet, Detector, RayMapError
from tracer.light import read_light


def far_field(cells: tuple[int, int], last: float, **parameters: Any) -> DetectorImage:
    """A tilted lobe over the half space, as flux in its cells."""
    detector = Detector(
        name="far",
        kind="far_field",
        cells=cells,
        parameters={"gamma_deg": (0.0, last), "angles": "type_c"} | parameters,
    )
    image = DetectorImage(
        detector=detector,
        channel_set=ChannelSet(
            kind="rgb", wavelengths_nm=(611, 549, 464), luminous=(0.2, 0.7, 0.1)
        ),
        flux_unit="lm",
        length_unit="mm",
        channels=np.zeros((cells[1], cells[0], 3)),
        variance=np.zeros((cells[1], cells[0])),
        rays=np.ones((cells[1], cells[0]), np.int64),
    )
    gamma = ((np.arange(cells[1]) + 0.5) * last / cells[1])[:, None]
    c = ((np.arange(cells[0]) + 0.5) * 360.0 / cells[0])[None, :]
    assert image.measure is not None
    image.channels[:, :, 1] = lobe(gamma, c, round_=cells[0] == 1) * image.measure.values
    return image


def lobe(gamma: Any, c: Any, *, round_: bool) -> Any:
    g = np.radians(gamma)
    tilt = 0.0 if round_ else 0.5 * np.sin(g) * np.cos(np.radians(c - 30.0))
    return 100.0 * np.cos(g / 2.0) ** 4 * (1.0 + tilt)


@pytest.mark.parametrize(("cells", "last"), [((72, 90), 180.0), ((72, 45), 90.0), ((1, 60), 120.0)])
def test_the_light_of_a_file_is_that_of_the_far_field(
    cells: tuple[int, int], last: float, tmp_path: Path
) -> None:
    image = far_field(cells, last)
    path = write_image(image, tmp_path / "lamp.ies")
    light = read_light(path)
    assert light.flux == pytest.approx(image.total, rel=5e-3)
    gamma = np.array([0.0, 10.0, 47.0, 80.0])
    for c in (0.0, 30.0, 117.0, 300.0):
        expected = lobe(gamma, c, round_=cells[0] == 1)
        np.testing.assert_allclose(light.at(gamma, np.full(4, c)), expected, rtol=0.01)
    assert max(map(len, path.read_text("ascii").splitlines())) < 256


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (far_field((8, 4), 90.0, angles="theta_phi"), "C planes and gamma from 0 on"),
        (far_field((8, 4), 90.0, gamma_deg=(10.0, 90.0)), "C planes and gamma from 0 on"),
    ],
)
def test_other_angles_are_refused(image: DetectorImage, message: str, tmp_path: Path) -> None:
    with pytest.raises(RayMapError, match=message):
        write_image(image, tmp_path / "lamp.ies")
    assert not list(tmp_path.iterdir())


def test_a_plane_has_no_intensity(maps: dict[str, Any], tmp_path: Path) -> None:
    import query

    picture = query.detector_image(maps["merged"], "screen")
    with pytest.raises(RayMapError, match="'screen' is of kind plane"):
        write_image(picture, tmp_path / "lamp.ies")
