"""How the faces of a scene lie to one another: which coincide, are hidden, come first."""
