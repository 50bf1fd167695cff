"""What detectors saw: pictures, files of them, and what is read off a distribution."""
