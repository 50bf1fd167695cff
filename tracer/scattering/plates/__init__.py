"""What a plate of a medium shows: solved, and walked."""
