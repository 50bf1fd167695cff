"""Laws that lie: ``NUMBA_BOUNDSCHECK=1 python tests/fuzz/fuzz_laws.py [seconds]``.

A small map states every form of law of surfaces and media. Values of these laws are changed, all
checksums made to fit again, and the map is opened, verified, and its laws are read and evaluated.
Whatever they say:

- nothing but the project's own errors is raised, no warning of NumPy either, and `verify` none;
- no compiled loop leaves its arrays (run with Numba's bounds checks, or this proves nothing of it);
- shares of light that are answered lie between 0 and 1 and do not exceed the light that arrives;
  densities are numbers, not negative;
- what was not changed is read as it was;
- where chunk and footer say different laws, `verify` finds it.

Cases are numbered as in `fuzz_values`, and run in another process as there.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import json
import random
import sys
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(_ROOT))

import numpy as np  # noqa: E402

import raymap  # noqa: E402
from query import path_table, select, what_if  # noqa: E402
from raymap.bytes.layout import CHANNELS, FOOTER  # noqa: E402
from raymap.file.verify import verify  # noqa: E402
from raymap.laws.lambertian import LambertianLaw  # noqa: E402
from raymap.laws.law import Law  # noqa: E402
from raymap.laws.medium import MediumLaw, transmitted  # noqa: E402
from raymap.laws.mirror import MirrorLaw  # noqa: E402
from raymap.laws.phase import PhaseLaw  # noqa: E402
from raymap.laws.radial import RadialScatter  # noqa: E402
from raymap.laws.retroreflector import RetroreflectorLaw  # noqa: E402
from raymap.laws.rough import RoughLaw  # noqa: E402
from raymap.laws.sheet import FilterLaw, PolariserLaw, RetarderLaw  # noqa: E402
from raymap.laws.smooth import AbsorberLaw, FresnelLaw  # noqa: E402
from raymap.laws.stack import StackLaw, StoredLayer  # noqa: E402
from raymap.laws.stored import FORMS, stored_laws  # noqa: E402
from raymap.laws.table import TableLaw  # noqa: E402
from raymap.laws.tabulated import MeasuredBsdf, TabulatedLaw  # noqa: E402
from tests.fuzz.fuzz_values import Seed, change_text, put_together  # noqa: E402
from tests.fuzz.supervised import command_line  # noqa: E402
from tests.raymap.maps import small_directory, write_small  # noqa: E402

NM = (450.0, 550.0, 610.0)
MEASURED = MeasuredBsdf(
    theta_i_deg=(0.0, 60.0),
    theta_o_deg=(0.0, 45.0, 80.0),
    phi_deg=(0.0, 90.0, 180.0),
    values=(((0.1, 0.1, 0.1),) * 3, ((0.2, 0.1, 0.05),) * 3),
)
SURFACES: tuple[Law, ...] = (
    AbsorberLaw(),
    FilterLaw(transmittance=(0.5, 0.9, 0.0), index=1.5),
    FresnelLaw(scatter=RadialScatter(abg=(0.01, 0.01, 2.0), reference_nm=550.0)),
    LambertianLaw(reflectance=(0.8, 0.6, 0.1), transmittance=(0.1, 0.2, 0.3)),
    MirrorLaw(n=(0.06, 0.06, 0.1), k=(3.0, 3.6, 4.0), roughness=0.2),
    MirrorLaw(
        reflectance=(0.9, 0.8, 0.7),
        scatter=RadialScatter(harvey_shack=(1.0, 0.01, -1.5), reference_nm=633.0),
    ),
    PolariserLaw(absorbs=(0.6, 0.8, 0.0), extinction=0.001, transmittance=(0.9, 0.8, 0.7)),
    RetarderLaw(slow=(1.0, 0.0, 0.0), retardance_nm=(125.0, 137.5, 150.0)),
    RetroreflectorLaw(reflectance=(0.3, 0.3, 0.3), spread_deg=2.0),
    RoughLaw(roughness=0.3),
    StackLaw(
        between=(0, 1),
        layers=(
            StoredLayer(thickness_nm=99.6, n=(1.38, 1.38, 1.37)),
            StoredLayer(thickness_nm=20.0, n=(0.1, 0.2, 0.3), k=(3.0, 3.1, 3.2)),
        ),
        scatter=RadialScatter(rho=(0.001, 0.1, 1.0), value=(1.0, 0.1, 0.001)),
    ),
    TableLaw(
        angle_deg=(0.0, 45.0, 90.0),
        reflectance=((0.1, 0.2, 0.9), (0.2, 0.3, 1.0), (0.0, 0.1, 0.5)),
        transmittance=((0.9, 0.7, 0.1), (0.7, 0.6, 0.0), (0.5, 0.5, 0.5)),
    ),
    TabulatedLaw(reflected=MEASURED, transmitted=MEASURED),
)
MEDIA = (
    MediumLaw(),
    MediumLaw(scattering=(0.1, 0.2, 0.3), phase=PhaseLaw(kind="rayleigh")),
    MediumLaw(scattering=(9.0, 9.0, 9.0), phase=PhaseLaw(kind="henyey_greenstein", g=0.9)),
    MediumLaw(phase=PhaseLaw(kind="generalized", g=-0.5, gamma=2.5)),
    MediumLaw(
        phase=PhaseLaw(kind="tabulated", angle_deg=(0.0, 30.0, 180.0), value=(5.0, 1.0, 0.2))
    ),
    MediumLaw(phase=PhaseLaw(kind="isotropic")),
)
COSINES = np.array([0.0, 1e-9, 0.3, 0.9, 1.0])


def seeds(folder: Path) -> list[Seed]:
    """One map that states every form."""
    assert {type(law) for law in SURFACES} == set(FORMS.values())
    index = tuple(3 * (1.0 + 0.1 * k,) for k in range(len(MEDIA)))
    stated = stored_laws(SURFACES, MEDIA)
    channels = raymap.ChannelSet(
        kind="spectral", wavelengths_nm=NM, refractive_index=index, laws=stated
    )
    directory = small_directory(
        surfaces=tuple(raymap.Surface(name=f"s{k}") for k in range(len(SURFACES))),
        media=tuple(raymap.Medium(name=f"m{k}") for k in range(len(MEDIA))),
    )
    path = folder / "laws.raymap"
    write_small(path, n_portions=1, n_rays=3, directory=directory, channels=channels)
    return [Seed("laws", path)]


def one_case(seed: Seed, dice: random.Random, path: Path) -> int:
    """Change laws of the map, and ask for them; returns the number of changes.

    Raises
    ------
    AssertionError
        A promise of this module's head does not hold.
    """
    parts = [
        dataclasses.replace(part, streams=[dataclasses.replace(each) for each in part.streams])
        for part in seed.parts
    ]
    texts = {
        part.tag: next(stream for stream in part.streams if stream.name == "json")
        for part in parts
        if part.tag in (CHANNELS, FOOTER)
    }
    chunk, footer = (json.loads(texts[tag].values.tobytes()) for tag in (CHANNELS, FOOTER))
    before, laws = copy.deepcopy(chunk["laws"]), chunk["laws"]
    n = dice.choice((1, 1, 2, 4, 16, 32))
    for _ in range(n):
        # A law, or one of them much more than others
        kind = dice.choice(("surfaces", "media"))
        held = {"laws": laws} if dice.random() < 0.05 else laws.get(kind)
        held = _inside(held, dice)
        if held is not None:
            change_text(held, dice)
    # The footer repeats what the chunk says; one of them alone contradicts the other
    told = dice.choice(((CHANNELS, FOOTER),) * 8 + ((CHANNELS,), (FOOTER,)))
    footer["channel_sets"][0]["laws"] = laws
    for tag, data in ((CHANNELS, chunk), (FOOTER, footer)):
        if tag in told:
            texts[tag].values = np.frombuffer(json.dumps(data).encode(), np.uint8)
    path.write_bytes(put_together(parts))
    sound = _exercise(path, before)
    _revise(path, dice)
    assert not sound or len(told) == 2 or laws == before, f"verify finds {told} alone sound"
    return n


_CHANGES: tuple[dict[str, object], ...] = (
    {"lens.reflectance": 0.5},
    {"box.reflectance": 0.5},
    {"lens.black": True},
    {"*.transmittance": 1e-300},
    {"m1.absorption": 1e30},
    {"m2.absorption": 1e-320},
    {"m3.scattering": 1e30},
    {"m4.scattering": 0.5, "m5.absorption": 0.1},
    {"lamp.flux": 10.0},
)


def _revise(path: Path, dice: random.Random) -> None:
    """Ask what would be under some changes; only the project's own errors are let go."""
    with contextlib.suppress(raymap.RayMapError), raymap.open(path, on_damage="skip") as ray_map:
        for changes in dice.sample(_CHANGES, 2):
            with contextlib.suppress(raymap.RayMapError):
                changed = what_if(ray_map, changes)
                select(changed, 'hit("*")', threads=1).flux  # noqa: B018
                path_table(changed, None, threads=1).rows(3)


def _inside(held: Any, dice: random.Random) -> Any:
    """The list of laws, or one law in it."""
    laws = [law for law in held if isinstance(law, dict) and law] if isinstance(held, list) else []
    if laws and dice.random() < 0.9:
        return dice.choice(laws)
    return held if isinstance(held, dict | list) and held else None


def _exercise(path: Path, before: dict[str, Any]) -> bool:
    """Read and evaluate what was changed; returns whether the map is found sound."""
    try:
        ray_map = raymap.open(path, on_damage="skip")
    except raymap.FormatError:
        return False
    with ray_map:
        if not ray_map.channel_sets:
            return False
        channels = ray_map.channel_sets[0]
        try:
            laws = ray_map.laws()
        except raymap.FormatError:
            laws = None
        if laws is not None:
            stated = channels.laws
            for number, law in enumerate(laws.surfaces):
                if stated["surfaces"][number] != before["surfaces"][number] and law is not None:
                    _evaluate(law, channels)
                elif law is not None:
                    assert law == SURFACES[number]
            for number, medium in enumerate(laws.media):
                if stated["media"][number] != before["media"][number] and medium is not None:
                    _evaluate_medium(medium)
                elif medium is not None:
                    assert medium == MEDIA[number]
        return not verify(ray_map).damage


def _evaluate(law: Law, channels: raymap.ChannelSet) -> None:
    """Its shares from both sides, and the tables of its scatter."""
    rare, dense = np.ones(len(NM)), np.array([1.5, 1.6, 2.4])
    for n_i, n_o in ((rare, dense), (dense, rare), (rare, rare)):
        try:
            back, through = law.shares(channels, n_i, n_o, COSINES)
        except raymap.RayMapError:
            break
        for part in (back, through, back + through):
            assert part.shape == (len(NM), len(COSINES)), law
            assert np.all((part >= -1e-6) & (part <= 1.0 + 1e-6)), law
    with contextlib.suppress(raymap.RayMapError):
        row = law.jones(channels)
        assert row is None or np.all(np.isfinite(row.numbers)), law
    scatter = getattr(law, "scatter", None)
    if scatter is not None:
        try:
            tables = scatter.tables(channels.wavelengths_nm)
        except raymap.RayMapError:
            return
        assert np.all(np.isfinite(tables)), law


def _evaluate_medium(medium: MediumLaw) -> None:
    left = transmitted(np.array(medium.scattering), 2.0)
    assert np.all((left >= 0.0) & (left <= 1.0)), medium
    if medium.phase is None:
        return
    try:
        density = medium.phase.density(np.array([-1.0, -0.5, 0.0, 0.99, 1.0]))
    except raymap.RayMapError:
        return
    assert np.all(np.isfinite(density) & (density >= 0.0)), medium


if __name__ == "__main__":
    sys.exit(command_line(Path(__file__), seeds, one_case))
