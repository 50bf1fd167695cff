"""Laws of scatter about the specular direction: a law a file."""
