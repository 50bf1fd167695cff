"""The served folder: confined, mirrored, bounded, with room on its disk."""
