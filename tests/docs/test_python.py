"""Python blocks of the pages run, page by page, and give what the pages say.

Blocks of a page share one namespace and one folder. What a block prints is compared with the block
of text after it; numbers and shapes in a comment with the value of its row.
"""

from __future__ import annotations

import ast
import importlib.util
import io
import itertools
import json
import re
import tokenize
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raymap
from query.expression.grammar import parse
from tests.docs.blocks import EVERY, ROOT, Block, blocks
from tests.docs.outside import SECRET, outside, served
from tests.docs.prepared import FEW_RAYS, RECORDED, own_folder
from tests.docs.sampled_output import says

BLOCKS = blocks("python")
PAGES = sorted({block.page for block in BLOCKS})
OUTPUTS = {
    after: block
    for block, after in itertools.pairwise(EVERY)
    if block.language == "python" and after.language == "text" and after.page == block.page
}
"""Blocks of text, and the Python that prints them."""

NEEDS = {
    ("docs/other_tracers.md", "import mitsuba as mi"): ("mitsuba", "another tracer"),
    ("docs/other_tracers.md", "import pvtrace"): ("pvtrace", "another tracer"),
    ("docs/service.md", "import FreeCAD"): ("FreeCAD", "runs inside FreeCAD"),
}
"""Blocks that need a program of others: where it is not installed, they are only compiled."""

SHORTER = {"wait(seconds=600)": "wait(seconds=0.5)", '"s3://': '"memory://'}
"""Nobody draws in the application here, and no cloud answers."""


def room(folder: Path) -> None:
    (folder / "room.xml").write_text(
        """<scene version="3.0.0">
        <shape type="sphere" id="shell"><float name="radius" value="2"/>
        <boolean name="flip_normals" value="true"/><bsdf type="diffuse"/></shape>
        <emitter type="point" id="lamp"><rgb name="intensity" value="2, 1, 1"/></emitter>
        </scene>""",
        encoding="utf-8",
    )


def served_lens(folder: Path) -> None:
    scene = (ROOT / "samples" / "double_gauss.toml").read_text(encoding="utf-8")
    (folder / "double_gauss.toml").write_text(scene, encoding="utf-8")
    (folder / "lens.raymap").unlink()


PREPARE: dict[str, Callable[[Path], None]] = {
    "docs/other_tracers.md": room,
    "docs/service.md": served_lens,
}


def criteria(names: dict[str, Any]) -> None:
    for name in ("ghosts", "order", "rough", "blue", "glare", "here", "through"):
        assert parse(str(names[name])) == names[name]


def recorder(_: dict[str, Any]) -> None:
    with raymap.open("mine.raymap") as ray_map:
        assert (ray_map.rays, ray_map.records) == (1, 3)


def shards(_: dict[str, Any]) -> None:
    for place in ("lens", "lens2", "memory://traces/lens"):
        with raymap.open(place) as lens:
            assert lens.rays == FEW_RAYS


def ordinary(names: dict[str, Any]) -> None:
    """Light across the optic axis is reflected by Fresnel's equations, s, of n_o = 1.65838."""
    outside, n = np.array([0.8, 1.0]), 1.65838
    inside = np.sqrt(n**2 - 1.0 + outside**2)
    reflected = ((outside - inside) / (outside + inside)) ** 2
    np.testing.assert_allclose(names["waves"].share[:, :2].sum(axis=1), reflected, atol=1e-4)


def picture(names: dict[str, Any]) -> None:
    assert names["pixels"].shape[2] == 3
    assert Path("lens.png").stat().st_size > 1_000


def lamp(names: dict[str, Any]) -> None:
    """Flux of 100 cos³ cd: 2π · 100 ∫ cos³ sin = 50 π lm."""
    from tracer import compile_scene

    [source] = compile_scene(names["scene"]).directory.sources
    assert source.flux == pytest.approx(50.0 * np.pi, rel=1e-3)


CHECK: dict[str, Callable[[dict[str, Any]], None]] = {
    "docs/cluster.md": shards,
    "docs/criteria.md": criteria,
    "docs/crystals.md": ordinary,
    "docs/other_tracers.md": recorder,
    "docs/scenes.md": lamp,
    "docs/viewer.md": picture,
}
"""What must have come of a page beyond what its blocks say."""


def shortened(text: str) -> tuple[str, float]:
    """The text with few rays, and how many times more the page records."""
    scale = 1.0

    def fewer(found: re.Match[str]) -> str:
        nonlocal scale
        rays = ast.literal_eval(found[1]) if "**" not in found[1] else 10 ** int(found[1][4:])
        scale = max(scale, rays / FEW_RAYS)
        return f"rays={min(rays, FEW_RAYS)}"

    text = re.sub(r"\brays=(10\*\*\d+|[\d_]+)", fewer, text)
    for long, short in SHORTER.items():
        text = text.replace(long, short)
    return text, RECORDED / FEW_RAYS if "lens.raymap" in text else scale


def comments(text: str) -> dict[int, str]:
    """Comments of a text by their rows."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {t.start[0]: t.string[1:].strip() for t in tokens if t.type == tokenize.COMMENT}


SHAPE = re.compile(r"\((\w+(?:, (?:\w+|…))+)\)")
VALUE = re.compile(r"(?<![\w.^⁻])-?\d+\.\d+(?:e-?\d+)?(?![\w.])")


def claims(comment: str) -> bool:
    """Whether a comment says a shape or a value."""
    return bool(SHAPE.match(comment) or VALUE.search(comment))


def holds(comment: str, value: Any) -> bool:
    """Whether a value has the shape and the numbers, to their digits, that a comment says."""
    arrays = value if isinstance(value, tuple) else (value,)
    if shape := SHAPE.match(comment):
        names = shape[1].split(", ")
        for array in map(np.asarray, arrays):
            open_end = names[-1] == "…"
            sizes = names[:-1] if open_end else names
            if array.ndim < len(sizes) or (array.ndim > len(sizes) and not open_end):
                return False
            pairs = zip(sizes, array.shape, strict=False)
            if any(name.isdigit() and int(name) != size for name, size in pairs):
                return False
    said = VALUE.findall(comment)
    found = np.concatenate([np.ravel(np.asarray(array)) for array in arrays]) if said else ()
    return len(said) <= len(found) and all(
        abs(float(number) - got) <= 0.51 * 10.0 ** -len(number.partition(".")[2])
        for number, got in zip(said, found, strict=False)
    )


def carry_out(block: Block, text: str, names: dict[str, Any]) -> None:
    """Run a block statement by statement, and hold the values of its rows against comments."""
    remarks = comments(text)
    for statement in ast.parse(text).body:
        rows = range(statement.lineno, (statement.end_lineno or 0) + 1)
        said = [remarks[row] for row in rows if claims(remarks.get(row, ""))]
        place = f"{block.page}:{block.line + statement.lineno - 1}"
        where = compile(ast.Module([statement], []), place, "exec")
        if not said:
            exec(where, names)
            continue
        [comment] = said
        if isinstance(statement, ast.Assign):
            exec(where, names)
            [target] = statement.targets
            assert isinstance(target, ast.Name), f"{place}: nothing to compare with {comment!r}"
            value = names[target.id]
        else:
            assert isinstance(statement, ast.Expr), f"{place}: nothing to compare with {comment!r}"
            value = eval(compile(ast.Expression(statement.value), place, "eval"), names)
        assert holds(comment, value), f"{place}: {value} is not {comment!r}"


def installed(block: Block) -> bool:
    return block.key not in NEEDS or importlib.util.find_spec(NEEDS[block.key][0]) is not None


@pytest.mark.parametrize("page", PAGES)
def test_python_blocks(
    page: str, folder: Path, run: Any, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    own = own_folder(page, folder / f"python_{Path(page).stem}", folder, run)
    if page in PREPARE:
        PREPARE[page](own)
    monkeypatch.chdir(own)
    monkeypatch.setenv("HOME", str(own))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    # A process of its own would compile the engine anew; tests of sharding start real ones
    monkeypatch.setattr(
        "concurrent.futures.ProcessPoolExecutor", lambda workers: ThreadPoolExecutor(1)
    )
    if importlib.util.find_spec("pyvista") is not None:
        monkeypatch.setattr("pyvista.OFF_SCREEN", True)
    names: dict[str, Any] = {}
    shown = {block: output for output, block in OUTPUTS.items()}
    with ExitStack() as stack:
        stack.callback(lambda: names["client"].close() if "client" in names else None)
        for block in BLOCKS:
            if block.page != page:
                continue
            compile(block.text, str(block), "exec")
            if not installed(block):
                continue
            text, scale = shortened(outside(block.text, own, stack))
            carry_out(block, text, names)
            printed = capsys.readouterr().out
            assert not printed or block in shown, f"{block} prints what the page does not show"
            if block in shown:
                assert_shown(shown[block], printed, scale)
        if page in CHECK:
            CHECK[page](names)


def assert_shown(output: Block, printed: str, scale: float) -> None:
    lines = iter(printed.splitlines())
    for expected in output.text.splitlines():
        assert any(says(expected, line, scale) for line in lines), (
            f"{output}: {expected!r} is not printed:\n{printed}"
        )


def test_what_the_program_in_c_sharp_sends(tmp_path: Path, folder: Path, run: Any) -> None:
    """The requests of the page's C#, sent by Arrow's client for Python."""
    from pyarrow import flight

    [block] = blocks("csharp")
    own = own_folder("docs/service.md", tmp_path / "served", folder, run)
    with ExitStack() as stack:
        client = stack.enter_context(flight.FlightClient(served(own, stack)))
        found = re.search(r'"authorization", "(\w+ )" \+ token', block.text)
        assert found is not None
        header = (b"authorization", (found[1] + SECRET).encode())
        options = flight.FlightCallOptions(headers=[header])
        string = r'"((?:[^"\\]|\\.)*)"'
        [(name, body)] = re.findall(rf'FlightAction\("(\w+)",\s*{string}', block.text)
        [answer] = client.do_action((name, json.loads(f'"{body}"').encode()), options)
        count = json.loads(answer.body.to_pybytes())
        assert 0 < count["matched"] < FEW_RAYS
        [ticket] = re.findall(rf"FlightTicket\(\s*{string}", block.text)
        ticket = flight.Ticket(json.loads(f'"{ticket}"'))
        assert client.do_get(ticket, options).read_all().num_rows == 500


@pytest.mark.parametrize(
    ("comment", "value", "good"),
    [
        ("(n, 4): 2 reflected", np.zeros((3, 4)), True),
        ("(n, 4, …)", (np.zeros((3, 4)), np.zeros((3, 4, 3))), True),
        ("(n, 4): 2 reflected", np.zeros((3, 5)), False),
        ("(n, 4)", np.zeros((3, 4, 1)), False),
        ("(rays, levels): 0.0416, 0.92, …", np.array([[0.04161, 0.92, 0.1]]), True),
        ("(rays, levels): 0.0416, 0.93, …", np.array([[0.04161, 0.92, 0.1]]), False),
        ("0.5, 0.6", np.array([0.5]), False),
    ],
)
def test_comments_are_compared(comment: str, value: Any, good: bool) -> None:
    assert claims(comment)
    assert holds(comment, value) is good
