"""The commands of CODE V lens files: which do not change the lens, and which stop the import.

`codev` reads what is neither here nor there by itself, and warns of every command
that stands nowhere. ``docs/lens_files.md`` lists what is listed here. Commands count by their first
three letters.
"""

from __future__ import annotations

__all__ = ["ALONE", "APERTURES_NOT_ROUND", "HARMLESS", "MOVED", "NOT_TAKEN", "TYPES"]

_TEXT = "text about the file"
_COUPLING = "says which values the optimisation may change"
_PROGRAM = "a setting of the program's own analyses and drawings"

HARMLESS = {
    "LEN": "starts a lens", "GO": "ends a command", "END": "ends a command", "INI": _TEXT,
    "VER": _TEXT, "SLB": _TEXT, "SLA": _TEXT, "UID": _TEXT, "COM": _TEXT, "CMT": _TEXT,
    "SAV": "writes a file", "DER": "sensitivities of a tolerance run",
    "CCY": _COUPLING, "CCX": _COUPLING, "THC": _COUPLING, "GLC": _COUPLING, "KC": _COUPLING,
    "AC": _COUPLING, "BC": _COUPLING, "CC": _COUPLING, "DC": _COUPLING, "EC": _COUPLING,
    "FC": _COUPLING, "GC": _COUPLING, "HC": _COUPLING, "JC": _COUPLING, "XDC": _COUPLING,
    "YDC": _COUPLING, "ZDC": _COUPLING, "ADC": _COUPLING, "BDC": _COUPLING, "CDC": _COUPLING,
    "CUM": "the back of a mirror", "THM": "the back of a mirror", "DOR": _PROGRAM,
    "CLS": "colours of drawings", "CA": _PROGRAM, "GLO": _PROGRAM, "POL": _PROGRAM,
    "ASP": "announces an asphere; its coefficients follow",
    "DAR": "how a decentre acts, of which there is none",
    "BEN": "how a decentre acts, of which there is none",
    "REV": "how a decentre acts, of which there is none",
}  # fmt: skip
"""Commands that do not change the lens, and why."""

ALONE = {"GO", "SPH", "CON", "ASP", "DAR", "BEN", "REV"}
"""Commands that have no values: a word behind them may be one that changes the lens."""

NOT_TAKEN = {
    "PUI": "the pupil is apodised; the sources fill it evenly",
    "PUX": "the pupil is apodised; the sources fill it evenly",
    "PUY": "the pupil is apodised; the sources fill it evenly",
    "APO": "the pupil is apodised; the sources fill it evenly",
    "MLT": "coatings are not taken; the faces are bare",
    "COA": "coatings are not taken; the faces are bare",
}  # fmt: skip
"""Commands that are warned about, and what is taken instead."""

MOVED = {
    "XDE", "YDE", "ZDE", "ADE", "BDE", "CDE", "ADX", "ADY", "ARO", "XOD", "YOD", "ZOD",
}  # fmt: skip
"""Shifts and tilts of surfaces and of their apertures: refused unless they are 0."""

TYPES = {
    "CYL": "a cylinder", "YTO": "a toroid", "XTO": "a toroid", "AAS": "an anamorphic asphere",
    "SPS": "a special surface", "DIF": "a diffractive surface", "GRT": "a grating",
    "HOE": "a hologram", "HCO": "a diffractive surface", "HOR": "a diffractive surface",
    "UDS": "a user-defined surface", "MFL": "an ideal lens module", "MOD": "an ideal lens module",
    "FRE": "a Fresnel surface", "SCO": "a splined or Zernike surface", "SPL": "a splined surface",
    "ZRN": "a Zernike surface", "BIR": "birefringent", "GRI": "a gradient index",
    "NSS": "a non-sequential range", "NSR": "a non-sequential range",
    "ARR": "an array of surfaces", "INT": "an error of form", "CUX": "a toroid", "RDX": "a toroid",
    "RET": "placed relative to another surface", "GLB": "placed relative to another surface",
    "INS": "put in by a command", "DEL": "changed by a command that takes surfaces away",
    "COP": "copied by a command", "FLY": "turned by a command", "SCA": "scaled by a command",
}  # fmt: skip
"""What makes a surface one that cannot be traced."""

APERTURES_NOT_ROUND = {
    "REX": "rectangular", "REY": "rectangular", "ELX": "elliptical", "ELY": "elliptical",
}  # fmt: skip
"""Apertures that are warned about: the semi-diameter is taken instead."""
