"""Make the pictures and figures of the pages in docs/samples.

    python docs/sample_pictures.py [NAME …]

Records each sample (seed 1) into a temporary folder, prints the figures of its page and writes
docs/images/sample_NAME.png.
"""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from PIL import Image

import query
import raymap
from query.answers.paths.ghosts import ghost_matrix
from raymap.optics.photometry import displayed
from tracer import load_scene, record
from viewer import ViewState, picture
from viewer.drawn.state import Camera, Section

mpl.use("Agg")
from matplotlib import pyplot as plt

ROOT = Path(__file__).resolve().parent.parent
IMAGES = ROOT / "docs" / "images"
SAMPLES = ROOT / "samples"
LARGEST = 195_000
DARK = "#0d1118"


def traced(folder: Path, scene: str, rays: int, *variants: str) -> Any:
    """Record a sample and open its map."""
    path = folder / f"{Path(scene).stem}{''.join(variants)}.raymap"
    result = record(load_scene(SAMPLES / scene, variants=variants), path, rays=rays, force=True)
    print(f"\n{scene} {' '.join(variants)}: {result.rays:,} rays, {result.seconds:.1f} s")
    for source, row in result.audit.items():
        print(f"  {source}: {row}")
    return raymap.open(path)


def flux(found: Any, criterion: str) -> tuple[float, float]:
    """Flux of a selection and its standard error."""
    answer = query.select(found, criterion)
    return answer.flux, answer.flux_se


def say(label: str, value: tuple[float, float], whole: float = 0.0) -> None:
    share = f"  {100 * value[0] / whole:6.2f} %" if whole else ""
    print(f"  {label:48s} {value[0]:.6g} ± {value[1]:.2g}{share}")


def save(image: Image.Image, name: str) -> None:
    """Write a PNG with as many colours as fit into the largest size."""
    for colors in (256, 160, 96, 64, 40):
        buffer = io.BytesIO()
        image.convert("RGB").quantize(colors, dither=Image.Dither.NONE).save(
            buffer, "PNG", optimize=True
        )
        if buffer.tell() < LARGEST:
            break
    (IMAGES / f"sample_{name}.png").write_bytes(buffer.getvalue())
    print(f"  sample_{name}.png: {image.size[0]} x {image.size[1]}, {buffer.tell() / 1000:.0f} kB")


def beside(left: Any, figure: Any) -> Image.Image:
    """A picture of the scene and a diagram of the same height."""
    pixels = Image.fromarray(left)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=100, facecolor=figure.get_facecolor())
    plt.close(figure)
    plot = Image.open(buffer).convert("RGB")
    plot = plot.resize((round(plot.width * pixels.height / plot.height), pixels.height))
    whole = Image.new("RGB", (pixels.width + plot.width, pixels.height))
    whole.paste(pixels, (0, 0))
    whole.paste(plot, (pixels.width, 0))
    return whole


def seen(
    *, position: Any, focal_point: Any, view_up: Any, height: float, parallel: bool = True
) -> Camera:
    """A camera from numbers of any kind."""
    place, focus, up = (tuple(float(x) for x in v) for v in (position, focal_point, view_up))
    return Camera(
        position=place, focal_point=focus, view_up=up, height=float(height), parallel=parallel
    )


def dark_figure(width: float, height: float, rows: int = 1) -> tuple[Any, Any]:
    plt.style.use("dark_background")
    figure, axes = plt.subplots(rows, 1, figsize=(width, height), layout="constrained")
    figure.set_facecolor(DARK)
    for ax in np.atleast_1d(axes):
        ax.set_facecolor(DARK)
    return figure, axes


def keyboard(folder: Path) -> None:
    """Which LED lights the centre key, and how?"""
    with traced(folder, "keyboard/keyboard.toml", 400_000) as found:
        table = np.zeros((3, 3, 5))
        for led in range(3):
            for row in range(3):
                for column in range(5):
                    key = f'source("led_{led + 1}") & detected("top_{"ABC"[row]}{column + 1}")'
                    table[led, row, column] = flux(found, key)[0]
        keys = table.sum(axis=0)
        print(f"  on the keys {keys.sum():.2f} lm of 60; darkest over brightest "
              f"{keys.min() / keys.max():.2f}")  # fmt: skip
        center = 'detected("top_B3")'
        whole = flux(found, center)[0]
        for led in (1, 2, 3):
            say(f"B3 from LED {led}", flux(found, f'source("led_{led}") & {center}'), whole)
        for label, criterion in (
            ("one dot", 'count(hit("dots", reflected)) == 1'),
            ("two dots or more", 'count(hit("dots", reflected)) >= 2'),
            ("no dot", 'count(hit("dots", reflected)) == 0'),
            ("the tape on an edge", 'hit("guide", diffuse_reflection)'),
            ("the foil below", 'hit("foil", reflected)'),
            ("another key first", 'hit("key_*", reflected)'),
            ("B3 up from B3 at its first hit", 'count(hit("key_*")) == 1'),
        ):
            say(f"B3 by {label}", flux(found, f"{center} & {criterion}"), whole)
        camera = seen(
            position=(-70, -150, 120), focal_point=(0, 0, 2), view_up=(0, 0, 1), height=96
        )
        state = ViewState(camera=camera, opacity=0.55, opacities={"foil": 0.25}, width=1.0)
        shown = f'{center} & count(hit("dots", reflected)) == 1'
        scene = picture(found, shown, rays=90, color="source", size=(900, 620), state=state)
        figure, axes = dark_figure(4.2, 6.2, 3)
        for led, ax in enumerate(axes):
            image = ax.imshow(table[led], cmap="inferno", vmin=0.0, vmax=table.max())
            for (row, column), value in np.ndenumerate(table[led]):
                ax.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=9,
                        color="white" if value < 0.6 * table.max() else "black")  # fmt: skip
            ax.set_title(f"LED {led + 1}: light through each key [lm]", fontsize=10)
            ax.set_xticks(range(5), range(1, 6))
            ax.set_yticks(range(3), "ABC")
        assert image is not None
        save(beside(scene, figure), "keyboard")


def prism(folder: Path) -> None:
    """Where does each wavelength land, and where does light go?"""
    with traced(folder, "prism_spectrometer.toml", 300_000) as found:
        wavelengths = np.array(found.channel_sets[0].wavelengths_nm)
        places: dict[int, list[Any]] = {k: [] for k in range(len(wavelengths))}
        for portion in found.portions:
            part = portion.read()
            last = np.cumsum(part.records_per_ray) - 1
            first = part.color_code[last[part.descriptor_count[last - 1] > 0]]
            across = (part.descriptors.uv[:, 0] / 65535.0 - 0.5) * 24.0
            for k in places:
                places[k].append(across[first == k])
        spots = {k: np.concatenate(v) for k, v in places.items()}
        means = np.array([spot.mean() for spot in spots.values()])
        widths = np.array([np.ptp(np.percentile(spot, [5, 95])) for spot in spots.values()])
        for wavelength, mean, width, spot in zip(
            wavelengths, means, widths, spots.values(), strict=True
        ):
            print(f"  {wavelength:.0f} nm: {mean:8.3f} mm, 90 % within {1000 * width:5.1f} um, "
                  f"{11 * len(spot) / 300_000:.3f} of its light")  # fmt: skip
        for label, criterion in (
            ("sensor", 'detected("sensor")'),
            ("reflected at the first face", 'path("beam prism.side_3:reflected .*")'),
            (
                "reflected at the second face",
                'path("beam prism.side_3:refracted prism.side_2:reflected .*")',
            ),
            ("absorbed in the glass", "event(volume_absorption)"),
            ("reflected at the lens", 'hit("lens", reflected) & !hit("prism", reflected)'),
            ("twice reflected, yet on the sensor", 'detected("sensor") & hit("*", reflected)'),
        ):
            say(label, flux(found, criterion), 1.0)
        camera = seen(
            position=(70, -45, 400), focal_point=(66, -44, 0), view_up=(0, 1, 0), height=175
        )
        scene = picture(
            found,
            'detected("sensor")',
            rays=500,
            color="wavelength",
            size=(860, 560),
            state=ViewState(camera=camera, opacity=0.4),
        )
        figure, ax = dark_figure(4.4, 5.6)
        colors = displayed(found.channel_sets[0], np.eye(len(wavelengths)))
        colors = (colors / colors.max(axis=1, keepdims=True)) ** (1 / 2.2)
        for k, spot in spots.items():
            counts, edges = np.histogram(spot, bins=240, range=(-12, 12))
            ax.fill_between(
                0.5 * (edges[1:] + edges[:-1]), counts / 1000, color=colors[k], alpha=0.9
            )
        ax.set_xlabel("place on the sensor [mm]")
        ax.set_ylabel("rays [thousand in 0.1 mm]")
        ax.set_title("450 … 650 nm in steps of 20 nm", fontsize=10)
        save(beside(scene, figure), "prism")


def room(folder: Path) -> None:
    """How much of the light on the desk comes straight, how much off the coloured walls?"""
    with traced(folder, "room.toml", 1_000_000) as found:
        desk = 'detected("desk")'
        whole = flux(found, desk)[0]
        say("on the desk", flux(found, desk), whole)
        for label, criterion in (
            ("straight from the lamp", 'path("lamp @desk .*")'),
            ("off the red wall", 'hit("red_wall", reflected) -> detected("desk")'),
            ("off the green wall", 'hit("green_wall", reflected) -> detected("desk")'),
            ("off the tall block", 'hit("tall_block", reflected) -> detected("desk")'),
            ("off the back wall", 'hit("back", reflected) -> detected("desk")'),
            ("off the ceiling", 'hit("ceiling", reflected) -> detected("desk")'),
        ):
            say(label, flux(found, criterion), whole)
        camera = seen(
            position=(0.0, 0.1, -6.0), focal_point=(0, -0.02, 0), view_up=(0, 1, 0), height=2.45,
            parallel=False,
        )  # fmt: skip
        state = ViewState(camera=camera, opacity=0.5, body_opacity=1.5, width=1.2)
        scene = picture(
            found, 'hit("*_wall", reflected) -> detected("desk")', rays=160, size=(820, 640),
            state=state,
        )  # fmt: skip
        save(Image.fromarray(scene), "room")


def sphere(folder: Path) -> None:
    """How much light gets out, and what does the coating's age cost?"""
    share = 0.5 * (1.0 - np.sqrt(1.0 - 0.2**2))
    results = {}
    for variant, rho in (((), 0.97), (("aged",), 0.95)):
        with traced(folder, "integrating_sphere.toml", 200_000, *variant) as found:
            out = flux(found, 'last(hit("port"))')
            say(f"out of the port, wall {rho}", out, 100.0)
            print(f"  formula {100 * share / (1 - rho * (1 - share)):.4f}")
            reflections = []
            ends = []
            for portion in found.portions:
                part = portion.read()
                count = part.records_per_ray - 2
                last = np.cumsum(part.records_per_ray) - 1
                reflections.append(count)
                port = [item.name for item in found.directory.objects].index("port")
                ends.append(part.object[last] == port)
            number, left = np.concatenate(reflections), np.concatenate(ends)
            mean = number.mean()
            print(
                f"  reflections of a ray {mean:.3f}, of light that gets out "
                f"{number[left].mean():.2f}"
            )
            results[rho] = number
            if rho == 0.97:
                camera = seen(
                    position=(300, 90, 120), focal_point=(0, 0, 0), view_up=(0, 1, 0), height=112
                )
                state = ViewState(
                    camera=camera, opacity=0.55, width=1.1, opacities={"sphere": 0.12}
                )
                scene = picture(
                    found, 'last(hit("port")) & bounces <= 12', rays=14, color="path",
                    size=(640, 560), state=state, legend=False,
                )  # fmt: skip
    figure, ax = dark_figure(5.0, 5.6)
    for rho, number in results.items():
        step = np.arange(0, 150)
        survived = np.array([(number >= k).mean() for k in step])
        line = ax.semilogy(step, survived, label=f"traced, wall {rho:.0%}")
        ax.semilogy(
            step[::6], (rho * (1 - share)) ** step[::6], "o", ms=4, mfc="none",
            color=line[0].get_color(), label="formula",
        )  # fmt: skip
    ax.set_ylim(1e-3, 1.2)
    ax.set_xlabel("reflections")
    ax.set_ylabel("share of the light still in the sphere")
    ax.legend()
    save(beside(scene, figure), "sphere")


def led(folder: Path) -> None:
    """How narrow is the beam, and which light misses it?"""
    with traced(folder, "led_lens/led_lens.toml", 400_000) as found:
        angles = []
        for portion in found.portions:
            part = portion.read()
            last = np.cumsum(part.records_per_ray) - 1
            left = last[part.object[last] < 0]
            angles.append(np.degrees(np.arccos(np.clip(part.normal[left, 2] / 32767.0, -1, 1))))
        angle = np.sort(np.concatenate(angles))
        print(f"  half of the light within {angle[len(angle) // 2]:.1f} deg, "
              f"0.9 within {angle[int(0.9 * len(angle))]:.1f} deg")  # fmt: skip
        rows = [
            ("through the dome", 'path("led lens.bottom:refracted lens.dome:refracted :left")'),
            ("through the side", 'path("led lens.bottom:refracted lens.side:refracted .*")'),
            ("reflected in the lens", 'hit("lens.dome", reflected) | hit("lens.side", reflected)'),
            ("beside the lens", '!hit("lens.bottom")'),
            ("reflected by the bottom from outside", 'path("led lens.bottom:reflected .*")'),
            ("absorbed by the board", 'last(hit("board"))'),
        ]
        for label, criterion in rows:
            say(label, flux(found, criterion), 100.0)
        camera = seen(
            position=(0, -60, 2.0), focal_point=(0, 0, 6.0), view_up=(0, 0, 1), height=16.5
        )
        state = ViewState(
            camera=camera, opacity=0.5, section=Section(on=True, normal=(0, -1, 0), offset=0.0,
            rays=False),
        )  # fmt: skip
        scene = picture(found, None, rays=260, color="reflections", size=(700, 560), state=state)
        figure, ax = dark_figure(5.0, 5.6)
        edges = np.linspace(0, 90, 61)
        solid = 2 * np.pi * (np.cos(np.radians(edges[:-1])) - np.cos(np.radians(edges[1:])))
        middle = 0.5 * (edges[1:] + edges[:-1])
        intensity = 100 * np.histogram(angle, edges)[0] / 400_000 / solid
        ax.plot(middle, intensity, label="with the lens")
        ax.plot(middle, 100 / np.pi * np.cos(np.radians(middle)), "--", label="bare LED")
        print(f"  intensity near the axis {intensity[:3].mean():.1f} cd, bare {100 / np.pi:.1f} cd")
        half = middle[np.argmax(intensity < intensity.max() / 2)]
        print(f"  intensity falls to half of its peak ({intensity.max():.0f} cd) at {half:.0f} deg")
        ax.set_xlabel("angle to the axis [degrees]")
        ax.set_ylabel("intensity [cd]")
        ax.legend()
        save(beside(scene, figure), "led")


def lens(folder: Path) -> None:
    """Which faces of a coated lens are worth a better coating?"""
    with traced(folder, "double_gauss.toml", 40_000, "fine_coating", "ghosts") as found:
        matrix = ghost_matrix(found, "sensor")
    known = matrix.flux_se[matrix.flux > 0] / matrix.flux[matrix.flux > 0]
    print(f"  {len(known)} pairs, error {100 * np.median(known):.1f} % in the middle, "
          f"{100 * known.max():.1f} % at most; all ghosts {matrix.total:.4e} W")  # fmt: skip
    part = matrix.flux.sum(axis=0) + matrix.flux.sum(axis=1)
    order = np.argsort(-part)
    for k in order:
        print(f"  {matrix.faces[k]:10s} takes part in {100 * part[k] / matrix.total:5.1f} %")
    for pair in matrix.pairs(6):
        print(
            f"  {pair['first']:8s} {pair['second']:8s} {pair['flux']:.3e} ± {pair['flux_se']:.1e}"
        )
    plt.style.use("dark_background")
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(9.8, 5.0), layout="constrained", width_ratios=(1.25, 1)
    )
    figure.set_facecolor(DARK)
    for ax in (left, right):
        ax.set_facecolor(DARK)
    shown = np.where(matrix.flux > 0, matrix.flux, np.nan)
    image = left.imshow(np.log10(shown), cmap="inferno")
    left.set_xticks(range(len(matrix.faces)), matrix.faces, rotation=60, ha="right", fontsize=9)
    left.set_yticks(range(len(matrix.faces)), matrix.faces, fontsize=9)
    left.set_ylabel("first reflection")
    left.set_xlabel("second reflection")
    bar = figure.colorbar(image, ax=left, shrink=0.8)
    bar.set_label("log10 of the flux on the sensor [W per W]")
    right.barh(
        [matrix.faces[k] for k in order[::-1]], 100 * part[order[::-1]] / matrix.total,
        color="#e8a33d",
    )  # fmt: skip
    right.set_xlabel("takes part in this share of the ghosts [%]")
    right.tick_params(labelsize=9)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=100, facecolor=DARK)
    plt.close(figure)
    save(Image.open(buffer), "double_gauss")


PAGES: dict[str, Callable[[Path], None]] = {
    "keyboard": keyboard, "prism": prism, "room": room, "sphere": sphere, "led": led, "lens": lens,
}  # fmt: skip


def main() -> None:
    names = sys.argv[1:] or list(PAGES)
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            PAGES[name](Path(folder))


if __name__ == "__main__":
    main()
