"""From columns to streams and back: dictionaries of paths, colours, geometry that shapes imply."""
