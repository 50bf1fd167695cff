"""A picture of a scene with the rays of a selection, without a screen."""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from raymap.model.errors import RayMapError
from raymap.model.extras import require
from raymap.model.replacing import replacing
from raymap.pictures.files import check_pixels, write_pixels
from viewer.drawn.camera import STANDARD_VIEWS, UPWARD
from viewer.drawn.scene import load_bodies
from viewer.drawn.state import COLOR_RULES, Upward, ViewState

if TYPE_CHECKING:
    from raymap.file.reader import RayMap

__all__ = ["NothingDrawn", "encode_jpeg", "encode_png", "picture"]

MAX_SIDE = 16_384


class NothingDrawn(UserWarning):
    """A picture has no rays, though its map has some."""


def encode_png(pixels: NDArray[np.uint8], *, colors: int | None = None) -> bytes:
    """PNG bytes of a (height, width, 3) picture; ``colors`` quantises it to a palette."""
    image = _pillow().fromarray(pixels)
    if colors is not None:
        image = image.quantize(colors, method=0, dither=1)
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def encode_jpeg(pixels: NDArray[np.uint8], quality: int = 88) -> bytes:
    """JPEG bytes of a (height, width, 3) picture."""
    buffer = io.BytesIO()
    _pillow().fromarray(pixels).save(buffer, "JPEG", quality=quality, subsampling=0)
    return buffer.getvalue()


def _pillow() -> Any:
    require("PIL")
    from PIL import Image

    return Image


def picture(
    map: RayMap,
    criterion: Any = None,
    *,
    out: str | Path | None = None,
    rays: int = 500,
    color: str | None = None,
    view: str | None = None,
    up: Upward | None = None,
    size: tuple[int, int] = (1600, 900),
    state: ViewState | None = None,
    paths: Sequence[tuple[str, str]] = (),
    legend: bool = True,
    caption: Sequence[str] = (),
    supersampling: int = 2,
    colors: int | None = None,
) -> NDArray[np.uint8]:
    """Paint the scene of a map with rays of a selection.

    Parameters
    ----------
    map : an open ray map
    criterion : text, tree or JSON; None selects every ray
    out : PNG file to write, through a file beside it
    rays : draw at most so many, the same ones every time
    color : one of `viewer.drawn.state.COLOR_RULES`; None takes the rule of ``state``
    view : one of `viewer.drawn.camera.STANDARD_VIEWS`; None sees long scenes from the side
    up : the axis that points upward in a standard view: y, z or x; None: that of ``state``
    size : width and height [pixels]
    state : everything else (section, clip, opacities, camera …)
    paths : (criterion, label) of paths to be shown alone, one colour each
    caption : lines of text in the upper left corner
    supersampling : paints so many times larger and averages
    colors : reduce the PNG to so many colours, for small files

    Returns
    -------
    (height, width, 3) uint8
    """
    from viewer.drawn.answers import draw_rays
    from viewer.paint.overlay import draw_legend
    from viewer.paint.painter import Painter

    width, height = size
    if not (16 <= width <= MAX_SIDE and 16 <= height <= MAX_SIDE):
        raise RayMapError(
            f"a picture is 16 to {MAX_SIDE} pixels wide and high, not {width}x{height}"
        )
    if out is not None:
        check_pixels(out)
    if color is not None and color not in COLOR_RULES:
        raise RayMapError(f"no colour rule {color!r}; there are {', '.join(COLOR_RULES)}")
    if view is not None and view not in STANDARD_VIEWS:
        raise RayMapError(f"no view {view!r}; there are {', '.join(STANDARD_VIEWS)}")
    if up is not None and up not in UPWARD:
        raise RayMapError(f"no axis {up!r}; y, z or x points upward")
    _pillow()
    base = state or ViewState()
    if color is not None:
        base = replace(base, color=cast(Any, color))
    painter = Painter(load_bodies(map.directory, map.meshes), map.directory)
    drawing = draw_rays(map, criterion, rays, paths=paths)
    shown = painter.show(base, drawing.rays, drawing.labels)
    if map.rays and not drawing.rays.n_rays:
        warnings.warn(
            "no ray satisfies the criterion: the picture shows the scene alone",
            NothingDrawn,
            stacklevel=2,
        )
    camera = base.camera
    if camera is None:
        camera = painter.standard(
            view, shown, width / height, parallel=view != "tilted", up=up or base.up
        )
    pixels = painter.paint(base, shown, camera, width, height, supersampling=supersampling)
    if legend or caption:
        key = shown.legend if legend else replace(shown.legend, entries=())
        pixels = draw_legend(
            pixels, key, caption=caption, dark=base.dark, size=max(11, round(height / 56))
        )
    if out is not None and colors is not None and Path(out).suffix.lower() == ".png":
        with replacing(Path(out)) as beside:
            beside.write_bytes(encode_png(pixels, colors=colors))
    elif out is not None:
        write_pixels(out, pixels)
    return pixels
