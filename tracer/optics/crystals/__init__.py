"""Light in isotropic, uniaxial and biaxial crystals."""
