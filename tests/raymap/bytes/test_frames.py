"""Compressed streams are single frames within the limits of the format's page (RFC 8878)."""

from __future__ import annotations

import numpy as np
import pytest
import xxhash
import zstandard

from raymap.bytes.chunks import StreamEntry
from raymap.bytes.streams import WHOLE, ZSTD, decode_bytes
from raymap.model.errors import FormatError

CONTENT = np.random.default_rng(1).integers(0, 4, 200_000).astype(np.uint8).tobytes()
SKIPPABLE = bytes.fromhex("502A4D18 04000000") + b"abcd"


def frame(content: bytes = CONTENT, **parameters: int) -> bytes:
    """A frame of the reference library."""
    chosen = zstandard.ZstdCompressionParameters.from_level(3, **parameters)
    return zstandard.ZstdCompressor(compression_params=chosen).compress(content)


def decoded(stored: bytes, raw_size: int = len(CONTENT)) -> bytes:
    digest = xxhash.xxh3_64_intdigest(stored)
    entry = StreamEntry("position", 1, ZSTD, WHOLE, 1, 1, raw_size, len(stored), digest)
    return bytes(decode_bytes(entry, stored))


def window(frame: bytes, code: int) -> bytes:
    """A frame of several segments (content size of 4 bytes) that states another window."""
    assert not frame[4] & 0x20
    return frame[:5] + bytes([code << 3]) + frame[6:]


def segments(n: int = len(CONTENT)) -> bytes:
    """A frame with a window descriptor: the window is smaller than the content."""
    return frame(CONTENT[:n], window_log=14)


@pytest.mark.parametrize("parameters", [{}, {"write_checksum": 1}, {"window_log": 14}])
def test_a_frame_is_read(parameters: dict[str, int]) -> None:
    assert decoded(frame(**parameters)) == CONTENT


def test_windows_end_at_128_mib() -> None:
    # RFC 8878, 3.1.1.1.2: the window is 2^(10 + exponent), the exponent in the upper five bits
    assert zstandard.get_frame_parameters(window(segments(), 17)).window_size == 2**27
    assert decoded(window(segments(), 17)) == CONTENT
    for exponent in (18, 21):
        with pytest.raises(FormatError, match="no single frame of 200000 bytes within the limits"):
            decoded(window(segments(), exponent))


@pytest.mark.parametrize(
    ("stored", "raw_size"),
    [
        (frame() + bytes(8), len(CONTENT)),
        (frame() + SKIPPABLE, len(CONTENT)),
        (SKIPPABLE + frame(), len(CONTENT)),
        (SKIPPABLE, 0),
        (SKIPPABLE, 4),
        (frame() + frame(b""), len(CONTENT)),
        (frame(CONTENT[:100_000]) + frame(CONTENT[100_000:]), len(CONTENT)),
        (frame(write_content_size=0), len(CONTENT)),
        (frame(), len(CONTENT) - 1),
        (frame(), len(CONTENT) + 1),
        (frame()[:-1], len(CONTENT)),
        (b"", 0),
        (frame()[:4], 0),
    ],
)
def test_anything_else_is_refused(stored: bytes, raw_size: int) -> None:
    with pytest.raises(FormatError, match=r"no single frame of \d+ bytes within the limits"):
        decoded(stored, raw_size)
