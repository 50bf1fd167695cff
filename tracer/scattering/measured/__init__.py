"""What was measured of plates, and its files."""
