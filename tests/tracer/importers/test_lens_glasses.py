"""Glasses of lens files: the catalogues of the file decide what a name means.

Right values: Malitson (1964) for barium fluoride, Icenogle et al. (1976) for germanium, Quan and
Fry (1995) for seawater, and the refractiveindex.info database as Optiland carries it.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from raymap.model.errors import SceneError
from tests.tracer.importers.lens_texts import opened, zemax
from tracer.importers.lens_scene import ImportedLens
from tracer.optics.glasses import find_shipped


def lens_of(
    folder: Path, glass: str, catalogues: str = "", nm: float = 587.5618
) -> tuple[ImportedLens, list[str]]:
    """A lens of one glass."""
    text = zemax(
        f"STOP;CURV 0.02;DISZ 5;GLAS {glass};DIAM 10 0", "CURV -0.02;DISZ 50;DIAM 10 0",
        "CURV 0;DISZ 0", head=f"GCAT {catalogues}" if catalogues else "",
    )  # fmt: skip
    return opened(folder, text.replace("0.5875618", f"{nm / 1000:g}"))


@pytest.mark.parametrize(
    ("glass", "catalogues", "nm", "index"),
    [
        ("BAF2 0 0 1.5 40", "SCHOTT INFRARED", 587.5618, 1.47448),
        ("BAF2", "INFRARED", 4000.0, 1.4567),
        ("BAF2", "CDGM INFRARED", 587.5618, 1.5697),
        ("BAF2 0 0 1.4744 81.6", "", 587.5618, 1.47448),
        ("GERMANIUM", "INFRARED", 10000.0, 4.0043),
        ("ZNSE", "INFRARED", 10600.0, 2.4028),
        ("SEAWATER", "MISC", 587.5618, 1.3395),
        ("QUARTZ", "MISC", 587.5618, 1.5443),
        ("SILICA", "MISC", 587.5618, 1.4585),
        ("CAF2", "", 587.5618, 1.4338),
    ],
)
def test_catalogues_decide(
    glass: str, catalogues: str, nm: float, index: float, tmp_path: Path
) -> None:
    lens, said = lens_of(tmp_path, glass, catalogues, nm)
    assert said == []
    assert lens.sequence.indices[1, 0] == pytest.approx(index, abs=6e-5)


def test_names_of_several_materials_are_asked_about(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"'BAF2' may be barium fluoride .*BAF2 .*say which"):
        lens_of(tmp_path, "BAF2", "SCHOTT")
    lens, said = lens_of(tmp_path, "BAF2 0 0 1.5697 49.4", "SCHOTT")
    assert lens.sequence.indices[1, 0] == pytest.approx(1.5697, abs=6e-5)
    assert "is taken for" in said[0]
    lens, said = lens_of(tmp_path, "S-BSL7", "SCHOTT")
    assert "is taken from Ohara; the catalogues of the file (SCHOTT) do not have it" in said[0]
    _, said = lens_of(tmp_path, "N-BK7 0 0 1.62 60", "SCHOTT")
    assert "Schott N-BK7 has the index 1.51680 at 587.6 nm, the file gives 1.62" in said[0]


def test_values_of_the_file_stand_for_unknown_glasses(tmp_path: Path) -> None:
    lens, said = lens_of(tmp_path, "MYGLASS 0 0 1.6204 60.3", "SCHOTT")
    assert lens.sequence.indices[1, 0] == pytest.approx(1.6204, abs=1e-6)
    assert "taken for a model glass of index 1.6204 and Abbe number 60.3" in said[0]
    lens, said = lens_of(tmp_path, "620603", "SCHOTT")
    assert lens.sequence.indices[1, 0] == pytest.approx(1.62, abs=1e-6)
    with pytest.raises(SceneError, match="no catalogue has the glass 'MYGLASS'"):
        lens_of(tmp_path, "MYGLASS 0 0 1.5 40", "SCHOTT")


def test_an_unknown_glass_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r"'N-NEW1'.*pip install opticalglass"):
        lens_of(tmp_path, "N-NEW1", "SCHOTT")


def test_pickups_and_models_of_glasses(tmp_path: Path) -> None:
    text = zemax(
        "STOP;CURV 0.02;DISZ 5;GLAS ___BLANK 1 0 1.62 60.3;DIAM 10 0", "CURV -0.02;DISZ 2",
        "CURV 0.02;DISZ 5;GLAS ___BLANK 2 1 1.7 30", "CURV -0.02;DISZ 20", "CURV 0;DISZ 0",
    )  # fmt: skip
    lens, said = opened(tmp_path, text)
    assert said == []
    assert lens.sequence.indices[1, 0] == lens.sequence.indices[3, 0]
    assert lens.sequence.indices[3, 0] == pytest.approx(1.62)


@pytest.mark.parametrize(
    ("name", "folder", "page", "micrometres"),
    [
        ("barium fluoride", "BaF2", "Malitson", 4.0), ("germanium", "Ge", "Icenogle", 10.0),
        ("silicon", "Si", "Salzberg", 4.0), ("zinc sulfide", "ZnS", "Debenham", 10.0),
        ("ZnSe", "ZnSe", "Connolly", 10.6), ("gallium arsenide", "GaAs", "Skauli", 10.0),
        ("lithium fluoride", "LiF", "Li", 4.0), ("sodium fluoride", "NaF", "Li", 4.0),
        ("sodium chloride", "NaCl", "Li", 10.0), ("potassium chloride", "KCl", "Li", 10.0),
        ("potassium bromide", "KBr", "Li", 10.0), ("caesium bromide", "CsBr", "Li", 10.0),
        ("caesium iodide", "CsI", "Li", 10.0), ("strontium fluoride", "SrF2", "Li", 4.0),
    ],
)  # fmt: skip
def test_crystals_agree_with_the_database(
    name: str, folder: str, page: str, micrometres: float
) -> None:
    materials = pytest.importorskip("optiland.materials")
    theirs = float(np.ravel(materials.Material(folder, reference=page).n(micrometres))[0])
    glass = find_shipped(name)
    assert glass is not None
    assert float(glass.index(1e3 * micrometres)) == pytest.approx(theirs, abs=1e-9)
