"""The backward renderer: furnace, bounds, resuming, files, and what is refused."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest

from raymap.model.errors import SceneError
from raymap.model.replacing import NotWritten
from raymap.pictures.files import write_pixels
from raymap.tables.exr import spectral_channels, write_exr
from tracer.render.camera import Camera
from tracer.render.images import to_bytes
from tracer.render.load import load_render_text
from tracer.render.renderer import Picture, error_in_steps, render, sample_pixels
from tracer.render.room import Room, checker_board, uniform
from tracer.render.scenes import bodies_of
from tracer.render.spectra import primary_spectra, rgb_weights, visible_wavelengths
from tracer.scene.compile import compile_scene
from tracer.scene.load import parse_scene

SCENE = """
length_unit = "mm"

[media.calcite]
crystal = {{ material = "calcite" }}

[bodies.rhomb]
kind = "rhomb"
medium = "calcite"
edge = 30
position = [0, 0, 0.01]

[room]
low = [-50, -50, 0]
high = [50, 50, 100]
{walls}

[camera]
position = [18, -95, 130]
target = [0, 0, 10]
up = [0, 0, 1]
sensor = [24, 21.75]
focal_length = 42
pixels = [12, 10]

[spectrum]
kind = "spectral"
wavelengths_nm = [450, 550, 650]

[render]
depth = 8
"""

WHITE = "all = [1, 1, 1]"
BOARD = """
[room.walls."z-".board]
colours = [[1, 0, 0], [0, 0, 1], [1, 1, 1]]
"""


@pytest.fixture(scope="module")
def furnace():
    return load_render_text(SCENE.format(walls=WHITE))


@pytest.fixture(scope="module")
def board():
    return load_render_text(SCENE.format(walls=BOARD))


@pytest.mark.parametrize(("analyser", "whole"), [(None, 1.0), (20.0, 0.5)])
def test_crystals_vanish_in_a_white_room(furnace, analyser, whole):
    scene = replace(furnace, camera=replace(furnace.camera, analyser_deg=analyser))
    x, y = np.meshgrid(np.arange(12), np.arange(10))
    seen = sample_pixels(scene, x.ravel(), y.ravel())
    total = seen.spectral / seen.white / whole + seen.pruned + seen.truncated
    np.testing.assert_allclose(total, 1.0, atol=1e-12)


def test_pruning_stays_within_half_a_step_and_within_its_bound(board):
    x, y = np.meshgrid(np.arange(3, 10), np.arange(3, 8))
    quick = sample_pixels(board, x.ravel(), y.ravel())
    whole = sample_pixels(replace(board, pruning_error=0.0), x.ravel(), y.ravel())
    difference = np.abs(quick.rgb - whole.rgb)
    assert error_in_steps(whole.rgb, difference).max() <= 0.5
    assert np.all(difference <= quick.error_bound + 1e-14)


def test_an_interrupted_picture_goes_on(board, tmp_path):
    state = tmp_path / "state.npz"
    whole = render(board, threads=1)

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(board, threads=1, state=state, progress=stop)
    assert state.exists()
    counts = []
    again = render(board, threads=2, state=state, progress=lambda a, b: counts.append(a))
    np.testing.assert_array_equal(again.spectral, whole.spectral)
    assert not state.exists()


def test_a_picture_that_cannot_be_written_is_not_rendered_again(run, tmp_path, monkeypatch):
    scene = tmp_path / "room.toml"
    scene.write_text(SCENE.format(walls=BOARD))
    target, state = tmp_path / "a.png", tmp_path / "a.png.state.npz"

    def refuse(self, path):
        raise NotWritten(path, "the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(Picture, "save", refuse)
        assert run("render", scene, "-o", target)[0] == 1
    assert state.exists()
    assert not target.exists()
    with monkeypatch.context() as patch:
        patch.setattr("tracer.render.renderer._tile", None)  # nothing is left to do
        code, _, said = run("render", scene, "-o", target)
    assert code == 0, said
    assert target.exists()
    assert not state.exists()
    old = target.read_bytes()
    assert run("render", scene, "-o", target, "--width", "6")[0] == 0
    assert target.read_bytes() != old


def test_bare_walls_have_their_colour():
    # A wall's colour comes back whatever wavelengths were chosen
    for wavelengths in (visible_wavelengths(21), [430.0, 540.0, 620.0], np.arange(400.0, 700.0, 7)):
        closed = rgb_weights(wavelengths).T @ primary_spectra(wavelengths)
        np.testing.assert_allclose(closed, np.eye(3), atol=1e-12)
    # With 21 of them the observer alone is nearly enough
    from raymap.optics.colorimetry import color_matching, xyz_to_linear_srgb

    wavelengths = visible_wavelengths(21)
    raw = xyz_to_linear_srgb(color_matching(wavelengths)).T @ primary_spectra(wavelengths)
    np.testing.assert_allclose(raw / raw[1, 1], np.eye(3), atol=0.03)
    assert primary_spectra(np.arange(380.0, 781.0)).min() >= 0.0


def test_cameras_agree_with_geometry():
    pinhole = Camera(
        position=(0, 0, 100), target=(0, 0, 0), sensor=(20, 10), focal_length=50, pixels=(4, 2)
    )
    rays = pinhole.rays(np.array([0]), np.array([0]))
    # Centre of the upper left pixel: 7.5 mm left and 2.5 mm up at 50 mm
    np.testing.assert_allclose(rays.direction[0] / -rays.direction[0, 2], [-0.15, 0.05, -1])
    lens = replace(pinhole, aperture_radius=5.0, focus_distance=80.0, samples=4)
    rays = lens.rays(np.array([1]), np.array([1]))
    focus = rays.origin + rays.direction * (80.0 / -rays.direction[:, 2:])
    # A pixel of 5 mm at 50 mm covers 8 mm at 80 mm; four samples a side stand at its eighths
    np.testing.assert_allclose(np.ptp(focus, axis=0), [6.0, 6.0, 0.0], atol=1e-12)
    assert np.linalg.norm(rays.origin - [0, 0, 100], axis=1).max() <= 5.0
    polar = replace(pinhole, analyser_deg=30.0).rays(np.array([2]), np.array([1]))
    assert abs(polar.analyser[0] @ polar.direction[0]) < 1e-15


def test_boards_deal_their_colours():
    texture = checker_board(
        [[1, 0, 0], [0, 1, 0]], squares=2, border_squares=1, border=[0.5, 0.5, 0.5],
        square_mm=10.0, size_mm=(60.0, 60.0), texels_per_mm=1.0,
    )  # fmt: skip
    assert texture.shape == (60, 60, 3)
    np.testing.assert_array_equal(texture[0, 0], 0.0)
    np.testing.assert_array_equal(texture[12, 30], 0.5)
    assert {tuple(texture[y, x]) for y in (25, 35) for x in (25, 35)} == {(1, 0, 0), (0, 1, 0)}


def read_exr(path):
    """Channels of a ZIP scan-line file, decoded step by step from its specification."""
    data = path.read_bytes()
    assert struct.unpack_from("<I", data)[0] == 20000630
    at, header = 8, {}
    while data[at]:
        end = data.index(b"\0", at)
        name, at = data[at:end].decode(), end + 1
        end = data.index(b"\0", at)
        at = end + 1
        (size,) = struct.unpack_from("<i", data, at)
        header[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    at += 1
    names, rest = [], header["channels"]
    while rest[0]:
        end = rest.index(b"\0")
        names.append(rest[:end].decode())
        rest = rest[end + 17 :]
    x0, y0, x1, y1 = struct.unpack("<4i", header["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    out = {name: np.zeros((height, width), np.float32) for name in names}
    for block in range(-(-height // 16)):
        (offset,) = struct.unpack_from("<Q", data, at + 8 * block)
        top, size = struct.unpack_from("<ii", data, offset)
        lines = min(16, height - top)
        packed = data[offset + 8 : offset + 8 + size]
        full = lines * width * 4 * len(names)
        if size < full:
            raw = np.frombuffer(zlib.decompress(packed), np.uint8).astype(np.int64)
            raw = np.cumsum(np.concatenate([raw[:1], raw[1:] - 128])) & 0xFF
            half = (len(raw) + 1) // 2
            mixed = np.zeros(len(raw), np.uint8)
            mixed[0::2], mixed[1::2] = raw[:half], raw[half:]
            packed = mixed.tobytes()
        values = np.frombuffer(packed, "<f4").reshape(lines, len(names), width)
        for k, name in enumerate(names):
            out[name][top : top + lines] = values[:, k]
    return out


def test_exr_files_hold_what_was_written(tmp_path):
    rng = np.random.default_rng(1)
    smooth = np.linspace(0.0, 3.0, 37 * 21).reshape(37, 21).astype(np.float32)
    noise = rng.normal(size=(37, 21)).astype(np.float32)
    channels = {"R": smooth, "G": noise} | spectral_channels([550.0], smooth[..., None])
    write_exr(tmp_path / "a.exr", channels)
    back = read_exr(tmp_path / "a.exr")
    assert sorted(back) == ["G", "R", "S0.550,000000nm"]
    np.testing.assert_array_equal(back["R"], smooth)
    np.testing.assert_array_equal(back["G"], noise)


def test_png_files_hold_what_was_written(tmp_path):
    image = pytest.importorskip("PIL.Image")
    pixels = to_bytes(np.random.default_rng(2).uniform(size=(13, 7, 3)))
    write_pixels(tmp_path / "a.png", pixels)
    np.testing.assert_array_equal(np.asarray(image.open(tmp_path / "a.png")), pixels)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("focal_length = 42", "focal_length = 0", "focal_length must be positive"),
        ("up = [0, 0, 1]", "up = [0, 0, 0]", "up must not point along"),
        ('medium = "calcite"', 'medium = "glass"', "there is no medium 'glass'"),
        ("depth = 8", "depth = 0", "render.depth"),
        ("depth = 8", "depht = 8", "render.depht"),
        ("high = [50, 50, 100]", "high = [50, 50, 10]", "sticks out of the room"),
        ('material = "calcite"', "indices = [1.5, -1.6, 1.7]", r"indices\[1\] is -1.6"),
        ('material = "calcite"', "indices = [1.5, 1.6, 1.7], axes = [[1,0,0],[1,1,0],[0,0,1]]",
         "not orthogonal"),
        ('material = "calcite"', "indices = [1.5, 1.6, 1.7], absorption = [0, -1e-4, 0]",
         "would amplify"),
        ("[bodies.rhomb]", "[[bodies]]", r"\[bodies.NAME\]"),
        ('kind = "rhomb"\nmedium = "calcite"\nedge = 30',
         'kind = "sphere"\nmedium = "calcite"\nradius = 3', "box, prism, rhomb and mesh"),
        ("[camera]", "[camara]", "camara: unknown key"),
        ("[room]", "[render.room]", "a picture needs .room. and .camera."),
        ("[spectrum]", "[spectrum", "not a TOML file"),
        ("pixels = [12, 10]", "pixels = [12, 0]", "at least 1"),
    ],
)  # fmt: skip
def test_scenes_that_cannot_be_are_refused_by_key(old, new, message):
    text = SCENE.format(walls=WHITE)
    assert old in text
    with pytest.raises(SceneError, match=message):
        load_render_text(text.replace(old, new))


def test_one_scene_is_recorded_and_rendered(tmp_path):
    text = (
        SCENE.format(walls=WHITE)
        + """
[sources.pencil]
kind = "collimated"
position = [0, 0, 60]
direction = [0, 0, -1]
diameter = 1
"""
    )
    scene = parse_scene(text)
    recorded = bodies_of(scene)
    rendered = load_render_text(text)
    np.testing.assert_array_equal(recorded[0].planes, rendered.bodies[0].planes)
    compiled = compile_scene(scene)
    assert compiled.channel_set.wavelengths_nm == tuple(rendered.wavelengths_nm)
    # Both see the same planes
    planes = np.array([face[3:6] for face in compiled.arrays.face_f])
    normals = recorded[0].planes[:, :3]
    assert all(np.abs(planes - normal).max(axis=1).min() < 1e-12 for normal in normals)
    with pytest.raises(SceneError, match="there is no source that is on"):
        compile_scene(parse_scene(SCENE.format(walls=WHITE)))


def test_rooms_know_their_walls():
    with pytest.raises(SceneError, match="wall 'floor' does not exist"):
        Room(low=(0, 0, 0), high=(1, 1, 1), walls={"floor": uniform([1, 1, 1])}).compile()
