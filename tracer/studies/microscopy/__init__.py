"""The polarising microscope."""
