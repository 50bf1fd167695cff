"""Pure functions of optics: numbers in, numbers out; no scene, no engine."""
