"""Keys of media: what says the index and the absorption of a medium; a key a file."""
