"""STEP files that are nested or copied without measure: one line, before OpenCASCADE sees them."""

from __future__ import annotations

import contextlib
import time
import tracemalloc

import pytest

from raymap.model.errors import SceneError
from tracer.importers.cad_formats.step_read import read_step
from tracer.importers.cad_formats.step_text import check_step_text

_HEAD = b"""ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
"""
_TAIL = b"\nENDSEC;\nEND-ISO-10303-21;\n"


def _file(*lines: bytes) -> bytes:
    return _HEAD + b"\n".join(lines) + _TAIL


def _assemblies(levels: int, copies: int) -> bytes:
    """Each level places the next one so many times."""
    lines = [b"#%d=PRODUCT_DEFINITION('it''s (','/*',$,$);" % k for k in range(1, levels + 2)]
    number = levels + 2
    for level in range(1, levels + 1):
        for _ in range(copies):
            lines.append(
                b"#%d=NEXT_ASSEMBLY_USAGE_OCCURRENCE('a','b''','#1',#%d,#%d,$);"
                % (number, level, level + 1)
            )
            number += 1
    return _file(*lines)


def _chain(length: int) -> bytes:
    return _file(*(b"#%d=OFFSET_SURFACE('',#%d,0.1,.F.);" % (k, k + 1) for k in range(1, length)))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            _file(b"#1=POINT('',", b"(" * 100_000, b"0.", b")" * 100_000, b");"),
            "lists more than 64",
        ),
        (_file(b"#1=POINT('',", b"(" * 5_000_000), "lists more than 64"),
        (_chain(100_000), "refer to each other more than 256 deep"),
        (_assemblies(5_000, 1), "refer to each other more than 256 deep"),
        (_assemblies(60, 2), "place 1e.18 parts"),
        (_assemblies(13, 2), "place 8192 parts"),
        (_file(b"#1=A(#2);", b"#2=B(#3,#1);", b"#3=C();"), "in a ring"),
        (_file(*(b"#%d=A(#%d);" % (k, k % 9 + 1) for k in range(1, 10)), b"#10=A(#1);"), "ring"),
    ],
)
def test_what_ends_or_stops_a_reader_is_refused(tmp_path, content, words):
    path = tmp_path / "a.step"
    path.write_bytes(content)
    begin = time.process_time()
    with pytest.raises(SceneError, match=words) as found:
        read_step(path)
    assert time.process_time() - begin < 30.0
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    "content",
    [
        _file(b"#1=A('((((((" + b"(" * 1000 + b"');"),
        _file(b"/* don't (((" + b"(" * 1000 + b" */ #1=A();"),
        _file(b"#1=A('/* ',#2,'*/ ''((');", b"#2=B();"),
        _chain(200),
        _assemblies(12, 2),
        _assemblies(200, 1),
        b"",
    ],
)
def test_what_is_honest_passes(content):
    check_step_text("a.step", content)


@pytest.mark.parametrize("repeated", [b"'", b"/*", b"#", b"#1=", b"(", b"''/*", b"#1=A(#2);\n"])
def test_time_is_in_proportion_to_the_file(repeated):
    """A hundred thousand times and ten times as often: no place is looked at again and again."""
    seconds = []
    for times in (100_000, 1_000_000):
        content = repeated * times
        tracemalloc.start()
        begin = time.process_time()
        with contextlib.suppress(SceneError):
            check_step_text("a.step", content)
        seconds.append(time.process_time() - begin)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 50 * len(content) + 400 * times
    assert seconds[1] < 30 * max(seconds[0], 0.1)
