"""Which medium and which surface a set of plates is."""
