"""Write the scene of the keyboard backlight: python samples/keyboard/make_scene.py

The printed dots are one mesh of small white squares in the light guide, just above its lower face.
They grow with the distance from the LEDs, so that the last keys are as bright as the first ones.
"""

from __future__ import annotations

from pathlib import Path

HERE = Path(__file__).parent

LENGTH, WIDTH, HEIGHT = 96.0, 60.0, 2.0
PITCH = 3.0
ROWS, COLUMNS = 3, 5
KEY = (17.0, 17.0)
SPACING = 19.0

HEAD = f"""# A keyboard lit from one edge: three LEDs shine into a light guide of acrylic; white
# dots printed on its lower face send the light up to the key caps. Lengths in mm; z points up.
# Written by make_scene.py, together with dots.obj.

title = "Keyboard backlight"
length_unit = "mm"
flux_unit = "lm"

[limits]
depth = 2000

[media.acrylic]
index = 1.49
absorption = 0.0002

[surfaces.ink]            # the white dots
kind = "lambertian"
reflectance = {{ rgb = [0.90, 0.90, 0.86] }}

[surfaces.tape]           # white tape on the edges without LEDs
kind = "lambertian"
reflectance = 0.92

[surfaces.foil]           # white foil under the guide
kind = "lambertian"
reflectance = 0.94

[surfaces.cap]            # key caps scatter light to both sides
kind = "lambertian"
reflectance = 0.40
transmittance = 0.45

[bodies.guide]
kind = "box"
size = [{LENGTH:g}, {WIDTH:g}, {HEIGHT:g}]
medium = "acrylic"
faces = {{ x_max = "tape", y_min = "tape", y_max = "tape" }}

[bodies.dots]
kind = "mesh"
file = "dots.obj"
scale = 1
name_by = "one"
surface = "ink"

[bodies.foil]
kind = "rectangle"
size = [{LENGTH + 4:g}, {WIDTH + 4:g}]
position = [0, 0, {-HEIGHT / 2 - 0.1:g}]
surface = "foil"

# ---- LEDs: flat white emitters before the left edge ----------------------------------------------
"""


def dots() -> str:
    """Squares in rows along the guide, larger the farther they are from the LEDs."""
    lines = ["# printed dots of the keyboard backlight, in mm; written by make_scene.py"]
    faces = []
    count = 0
    z = -HEIGHT / 2 + 0.01
    for i in range(int(LENGTH / PITCH)):
        for j in range(int(WIDTH / PITCH)):
            x = -LENGTH / 2 + PITCH * (i + 0.5)
            y = -WIDTH / 2 + PITCH * (j + 0.5)
            along = (x + LENGTH / 2) / LENGTH
            half = 0.35 + 0.75 * along**1.2
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                lines.append(f"v {x + a * half:.3f} {y + b * half:.3f} {z:.3f}")
            faces.append(f"f {count + 1} {count + 2} {count + 3} {count + 4}")
            count += 4
    return "\n".join(lines + faces) + "\n"


def scene() -> str:
    """The scene file."""
    parts = [HEAD]
    for number, y in enumerate((-20.0, 0.0, 20.0), start=1):
        parts.append(
            f"[sources.led_{number}]\n"
            'kind = "lambertian"\n'
            "size = [1.4, 2.6]\n"
            f"position = [{-LENGTH / 2 - 0.1:g}, {y:g}, 0]\n"
            "axis = [1, 0, 0]\n"
            "flux = 20\n"
        )
    parts.append("# ---- keys: a cap each, and a detector on top of it -----------------------\n")
    for row in range(ROWS):
        for column in range(COLUMNS):
            name = f"key_{'ABC'[row]}{column + 1}"
            x, y = SPACING * (column - (COLUMNS - 1) / 2), SPACING * ((ROWS - 1) / 2 - row)
            parts.append(
                f"[bodies.{name}]\n"
                'kind = "rectangle"\n'
                f"size = [{KEY[0]:g}, {KEY[1]:g}]\n"
                f"position = [{x:g}, {y:g}, 4]\n"
                'surface = "cap"\n\n'
                f"[detectors.top_{name[4:]}]\n"
                f"position = [{x:g}, {y:g}, 4.2]\n"
                "looks = [0, 0, -1]\n"
                f"size = [{KEY[0]:g}, {KEY[1]:g}]\n"
                "cells = [8, 8]\n"
            )
    return "\n".join(parts)


if __name__ == "__main__":
    (HERE / "dots.obj").write_text(dots(), encoding="utf-8")
    (HERE / "keyboard.toml").write_text(scene(), encoding="utf-8")
