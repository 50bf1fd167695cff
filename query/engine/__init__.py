"""A criterion on a map: bound to its names, decided on paths, then on the rays left open."""
