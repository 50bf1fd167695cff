"""What every ray needs: random numbers, directions, colour codes."""
