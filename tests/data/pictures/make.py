"""Paint the kept pictures anew; look at them before committing.

Run it as ``python -m tests.data.pictures.make``.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import raymap
from tests.viewer.paint.test_picture import SCENES
from tests.viewer.small_map import write_map
from viewer import picture

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        ray_map = raymap.open(write_map(Path(folder) / "small.raymap"))
        for name, scene in SCENES.items():
            arguments = dict(scene)
            text = arguments.pop("criterion") or None
            out = Path(__file__).parent / f"{name}.png"
            picture(ray_map, text, size=(320, 200), rays=80, legend=False, out=out, **arguments)
        ray_map.close()
