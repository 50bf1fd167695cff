"""Bytes of a map: where they come from, chunks, streams with their checksums."""
