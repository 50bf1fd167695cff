"""A map on disk: written, continued, read, verified, repaired, joined from shards."""
