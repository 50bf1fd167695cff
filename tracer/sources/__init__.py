"""Sources of a scene: their keys, and how they emit."""
