"""Coverage-guided fuzzing of the reader: ``python tests/fuzz/fuzz_reader.py [corpus] [-runs=N]``.

Needs atheris. Each input is a mutated golden map; after every mutation a part of the checksums is
made to fit again, so that the fuzzer gets behind them. Whatever the bytes, reading ends in a
`FormatError` or in skipped portions: any other exception, a hang or unbounded memory is a finding.
"""

from __future__ import annotations

import contextlib
import importlib
import random
import struct
import sys
import tempfile
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(_ROOT))

_PARSERS = (
    "bytes.chunks",
    "bytes.layout",
    "bytes.streams",
    "encoding.description",
    "file.footer",
    "file.reader",
    "file.stored",
)
"""Modules whose branches guide the fuzzer; compiled functions cannot be instrumented."""

if __name__ == "__main__":
    import atheris

    with atheris.instrument_imports(include=[f"raymap.{name}" for name in _PARSERS]):
        for _name in _PARSERS:
            importlib.import_module(f"raymap.{_name}")

import xxhash  # noqa: E402

import raymap  # noqa: E402
from raymap.bytes.layout import (  # noqa: E402
    CHUNK_HEADER_SIZE,
    FILE_HEADER_SIZE,
    STREAM_ENTRY_SIZE,
    TAG_PREFIX,
    header_size,
)
from raymap.file.verify import verify  # noqa: E402

_FOLDER = tempfile.TemporaryDirectory(prefix="raymap-fuzz-")
_PATH = Path(_FOLDER.name) / "input.raymap"


def read_everything(data: bytes) -> None:
    """Read all that a reader offers of a file of any content."""
    _PATH.write_bytes(data)
    try:
        ray_map = raymap.open(_PATH, on_damage="skip")
    except raymap.FormatError:
        return
    with ray_map:
        ray_map.describe()
        with contextlib.suppress(raymap.FormatError):
            ray_map.meshes  # noqa: B018
        ray_map.merged  # noqa: B018
        for detector in ray_map.directory.detectors:
            ray_map.detector_result(detector.name)
        for stored in ray_map.portions:
            if stored.n_records > 2**18 or stored.n_descriptors > 2**18:
                continue
            with contextlib.suppress(raymap.DamagedPortion):
                stored.read()
                stored.segments()
                stored.paths().sum_wc  # noqa: B018
        if ray_map.records < 2**18:
            verify(ray_map)


def mend(data: bytes) -> bytes:
    """Make the checksums of all chunk headers and streams fit their bytes again."""
    mended = bytearray(data)
    place = mended.find(TAG_PREFIX, FILE_HEADER_SIZE)
    while place >= 0:
        after = place + 1
        with contextlib.suppress(raymap.FormatError, struct.error):
            after = max(after, _mend_chunk(mended, place))  # names inside may look like tags
        place = mended.find(TAG_PREFIX, after)
    return bytes(mended)


def _mend_chunk(data: bytearray, offset: int) -> int:
    """Mend one chunk; the offset behind it."""
    end = offset + header_size(bytes(data[offset : offset + CHUNK_HEADER_SIZE]))
    (meta_size,) = struct.unpack_from("<I", data, offset + 12)
    row = offset + CHUNK_HEADER_SIZE + meta_size
    stream = end
    while row < end <= len(data):
        (stored,) = struct.unpack_from("<Q", data, row + 48)
        content = bytes(data[stream : stream + stored])
        struct.pack_into("<Q", data, row + 56, xxhash.xxh3_64_intdigest(content))
        stream += stored
        row += STREAM_ENTRY_SIZE
    head = bytes(data[offset : offset + 24]) + bytes(data[offset + CHUNK_HEADER_SIZE : end])
    struct.pack_into("<Q", data, offset + 24, xxhash.xxh3_64_intdigest(head))
    return stream


def one_input(data: bytes) -> None:
    """The fuzz target: the last byte says whether checksums are mended."""
    if data:
        read_everything(mend(data[:-1]) if data[-1] % 4 else data[:-1])


def seeds() -> list[bytes]:
    """Contents of the golden maps, each with the byte that says how to treat it."""
    golden = sorted((_ROOT / "tests" / "data" / "golden").rglob("*.raymap"))
    return [path.read_bytes() + bytes([flag]) for path in golden for flag in (0, 1)]


def mutate(data: bytes, dice: random.Random) -> bytes:
    """Some random damage, mostly in headers and stream tables."""
    damaged = bytearray(data)
    tags = [k for k in range(len(data) - 8) if data[k : k + 5] == TAG_PREFIX]
    for _ in range(dice.randint(1, 6)):
        if dice.random() < 0.8:
            place = dice.choice(tags) + dice.randint(0, 600)
        else:
            place = dice.randrange(len(damaged))
        place = min(place, len(damaged) - 2)
        kind = dice.random()
        if kind < 0.5:
            damaged[place] ^= 1 << dice.randint(0, 7)
        elif kind < 0.8:
            damaged[place] = dice.choice((0, 1, 2, 127, 128, 255))
        elif kind < 0.9:
            del damaged[place : place + dice.randint(1, 64)]
        else:
            damaged[place:place] = dice.randbytes(dice.randint(1, 16))
    return bytes(damaged)


def short_run(n: int, seed: int = 1) -> int:
    """Random mutations without atheris; returns how many inputs were read."""
    dice = random.Random(seed)
    start = seeds()
    for _ in range(n):
        one_input(mutate(dice.choice(start), dice))
    return n


def main() -> None:
    """Run atheris with the golden maps as seeds."""
    corpus = Path(_FOLDER.name) / "seeds"
    corpus.mkdir()
    for number, content in enumerate(seeds()):
        (corpus / f"seed{number}").write_bytes(content)

    def mutator(data: bytes, max_size: int, seed: int) -> bytes:
        dice = random.Random(seed)
        if len(data) > 100 and dice.random() < 0.7:
            return mutate(data, dice)[:max_size]
        return bytes(atheris.Mutate(data, max_size))

    arguments = [sys.argv[0], "-max_len=131072", "-rss_limit_mb=4096", "-timeout=30"]
    arguments += [*sys.argv[1:], str(corpus)]
    atheris.Setup(arguments, one_input, custom_mutator=mutator)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
