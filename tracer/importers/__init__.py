"""Files of other programs as scenes: lens prescriptions (Zemax, CODE V) and CAD (STEP)."""
