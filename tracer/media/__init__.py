"""Media of a scene, and what happens on the way through them."""
