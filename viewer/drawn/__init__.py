"""What is drawn of a map: bodies, rays, colours, seen by a camera."""
