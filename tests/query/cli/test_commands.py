"""The commands as a user runs them: output, JSON keys, exit codes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import query
import raymap
from tests.query.engine.test_damage import position_bytes
from tests.query.random_maps import write_random_map


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("commands")
    return write_random_map(folder / "a.raymap", 21, rays=200, paths=40)


@pytest.fixture
def run(run: Any) -> Any:
    """Output and messages of a command that must end with ``code``."""

    def command(*words: str | Path, code: int = 0) -> tuple[str, str]:
        found, out, err = run(*words)
        assert found == code, err
        return out, err

    return command


def test_query(run: Any, path: Path, tmp_path: Path) -> None:
    text = 'hit("L1", reflected)'
    out, _ = run("query", path, text, "--count", "--json")
    answer = json.loads(out)
    assert set(answer) >= {
        *("rays", "matched", "flux", "flux_se", "seconds", "portions", "portions_read"),
        *("bytes_read", "damaged"),
    }
    assert "ray_ids" not in answer
    with raymap.open(path) as map:
        expected = query.select(map, text)
        assert answer["matched"] == expected.matched
        out, _ = run("query", path, text, "--json")
        assert json.loads(out)["ray_ids"] == expected.ray_ids.tolist()
        out, _ = run("query", path, text, "--limit", "2", "--json")
        assert json.loads(out)["ray_ids"] == expected.ray_ids[:2].tolist()
    out, _ = run("query", path, text)
    assert "rays" in out
    out, _ = run("query", path, text, "--explain")
    assert "portions to read" in out
    out, _ = run("query", path, text, "--explain", "--json")
    assert json.loads(out)["steps"][0]["rays"] == answer["matched"]
    out, _ = run("query", path, "R1", "--filter-string", "--count", "--json")
    assert json.loads(out)["matched"] == answer["matched"]
    for name in ("b.raymap", "b.parquet", "b.arrow", "b.csv"):
        run("query", path, text, "-o", tmp_path / name)
        assert (tmp_path / name).stat().st_size > 0
    out, _ = run("query", tmp_path / "b.raymap", "--count", "--json")
    assert json.loads(out)["matched"] == answer["matched"]
    assert json.loads(out)["flux"] == pytest.approx(answer["flux"])


def test_paths(run: Any, path: Path) -> None:
    out, _ = run("paths", path, 'detected("screen")', "--top", "3", "--json")
    rows = json.loads(out)
    assert all(
        set(row) >= {"path", "criterion", "rays", "flux", "flux_se", "share"} for row in rows
    )
    assert rows[-1]["path"] == "remainder"
    assert sum(row["share"] for row in rows) == pytest.approx(1)
    for options in (["--by", "object"], ["--sort", "rays"], ["--sort", "peak", "--peak", "eye"]):
        out, _ = run("paths", path, *options)
        assert "remainder" in out
    run("paths", path, "--by", "nonsense", code=2)


def test_report_and_image(run: Any, path: Path, tmp_path: Path) -> None:
    out, _ = run("report", path, "7", "--json")
    ray = json.loads(out)
    assert set(ray) >= {"ray_id", "source", "points"}
    assert set(ray["points"][0]) >= {
        *("position", "object", "face", "triangle", "events", "normal", "incidence_deg", "medium"),
        *("refractive_index", "medium_parameters", "length", "color", "spectrum", "detectors"),
    }
    out, _ = run("report", path, "7")
    assert ray["source"] in out
    _, error = run("report", path, "99999999", code=1)
    assert error.startswith("error: ")
    out, _ = run("image", path, "screen", "-o", tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    layer = "tir=event(tir)"
    run("image", path, "screen", "-o", tmp_path / "a.npy", "--kind", "flux", "--layer", layer)
    assert (tmp_path / "a-tir.npy").exists()
    run("image", path, "screen", code=2)
    _, error = run("image", path, "scren", "-o", tmp_path / "c.png", code=1)
    assert "nearest: screen" in error
    assert not (tmp_path / "c.png").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["audit"],
        ["ghosts"],
        ["illuminated", "screen"],
        ["sweep", "screen"],
    ],
)
def test_studies(run: Any, path: Path, words: list[str]) -> None:
    command, *rest = words
    out, _ = run(command, path, *rest, "--json")
    assert json.loads(out)
    out, _ = run(command, path, *rest)
    assert out


def test_compare(run: Any, path: Path) -> None:
    out, _ = run("compare", path, path, "--json")
    assert json.loads(out)["significant"] == 0
    out, _ = run("compare", path, path)
    assert "significant" in out


def test_bad_criteria_are_one_clear_error(run: Any, path: Path, tmp_path: Path) -> None:
    for text in ('hit("L1"', 'hit("L9")', "hitt()", 'path("lamb .*")'):
        out, error = run("query", path, text, code=1)
        assert out == ""
        assert error.startswith("error: ")
        assert "Traceback" not in error
    run("query", path, "event(left)", "-o", tmp_path / "a.xlsx", code=1)
    run("query", path, "event(left)", "--limit", "0", code=2)
    run("query", tmp_path / "none.raymap", "event(left)", code=1)


def test_damage_is_said_and_strictness_fails(run: Any, path: Path, tmp_path: Path) -> None:
    copy = tmp_path / "bad.raymap"
    data = bytearray(path.read_bytes())
    with raymap.open(path) as map:
        for place in position_bytes(map.portions[1]):
            data[place] ^= 0x3C
    copy.write_bytes(data)
    out, error = run("query", copy, "length > 5", "--json")
    assert "portion 1" in error
    assert [entry["portion"] for entry in json.loads(out)["damaged"]] == [1]
    run("query", copy, "length > 5", "--strict", code=1)


def test_all_means_every_ray(run: Any, path: Path) -> None:
    answers = [
        json.loads(run("query", path, *words, "--count", "--json")[0])
        for words in ([], ["all"], ["all()"], ["count(all) >= 1"], ["!!all"])
    ]
    assert [answer["matched"] for answer in answers] == [answers[0]["rays"]] * 5
    assert json.loads(run("query", path, "!all", "--count", "--json")[0])["matched"] == 0


def test_an_error_points_below_the_criterion(run: Any, path: Path) -> None:
    _, err = run("query", path, 'hit("L9") & event(left)', code=1)
    line, carets = err.splitlines()
    assert line.startswith('error: hit("L9") & event(left): ')
    assert carets.index("^") == line.index('"L9"')
    assert carets.strip() == "^^^^"
    long = " & ".join(['hit("L1")'] * 20 + ['hit("L9")'])
    _, err = run("query", path, long, code=1)
    message, shown, carets = err.splitlines()
    assert "column" in message
    assert shown[carets.index("^") :] == '"L9")'


def test_tables_keep_their_units(run: Any, path: Path) -> None:
    with raymap.open(path) as map:
        number = int(map.portions[0].ray_ids()[0])
    out, _ = run("report", path, number)
    assert "position [mm]" in out
    assert "length [mm]" in out
