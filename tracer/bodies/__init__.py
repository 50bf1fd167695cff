"""Bodies of a scene: a kind a file."""
