"""Phase functions: where a scattering medium sends light; a function a file."""
