"""Which paths the light takes: tables, ghosts, the brightest cells by path."""
