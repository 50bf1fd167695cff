"""The words of Zemax lens files: which do not change the lens, and which stop the import.

`zemax` reads what is neither here nor there by itself, and warns of every word
that stands nowhere. ``docs/lens_files.md`` lists what is listed here.
"""

from __future__ import annotations

__all__ = [
    "APERTURES_NOT_ROUND",
    "HARMLESS_IN_HEAD",
    "HARMLESS_IN_SURFACES",
    "TYPES",
    "VALUES",
    "WORDS_OF_HEAD",
    "WORDS_OF_SURFACES",
]

_TEXT = "text about the file"
_PROGRAM = "a setting of the program's own analyses and drawings"
_SEARCH = "how the program searches and optimises"
_RAYS = "how the program finds rays; here every ray is aimed at the real stop"

HARMLESS_IN_HEAD = {
    "VERS": _TEXT, "NOTE": _TEXT, "AUTH": _TEXT, "LUID": _TEXT, "LANG": _TEXT, "DBDT": _TEXT,
    "PFIL": _PROGRAM, "PICB": _PROGRAM, "ROPD": _PROGRAM, "NSCD": _PROGRAM, "COFN": _PROGRAM,
    "POLS": _PROGRAM, "IWDP": _PROGRAM, "GLRS": _PROGRAM, "STUD": _PROGRAM, "TOTR": _PROGRAM,
    "EFFL": _PROGRAM, "PMAG": _PROGRAM, "RCMF": _PROGRAM, "TCMM": _PROGRAM,
    "SDMA": "a margin that the semi-diameters of the file contain already",
    "OMMA": _SEARCH, "EERA": _SEARCH, "GSTD": _SEARCH, "HYPR": _SEARCH, "GLCB": _SEARCH,
    "ACOS": _SEARCH, "BLNK": _SEARCH, "DMFS": _SEARCH, "WFNO": _SEARCH, "TOL": "tolerances",
    "TOLE": "tolerances", "MNCA": _SEARCH, "MNEA": _SEARCH, "MNCG": _SEARCH, "MNEG": _SEARCH,
    "MXCA": _SEARCH, "MXCG": _SEARCH, "RGLA": _SEARCH,
    "RAIM": _RAYS, "PUSH": _RAYS, "PUPD": _RAYS,
    "MOFF": "a row of the configurations that is switched off",
}  # fmt: skip
"""Words outside of the surfaces that do not change the lens, and why."""

HARMLESS_IN_SURFACES = {
    "HIDE": "what drawings leave out",
    "MIRR": "how drawings show the back of a mirror",
    "SLAB": "a number that the program gives to the surface",
    "SSID": "a number that the program gives to the surface",
    "FIMP": "the name of a file that the surface was taken from",
    "POPS": "settings of physical optics",
    "OEMA": "the chip zone of the edge, outside of the clear aperture",
    "TCED": "thermal expansion, of which the values at the file's temperature are stored",
    "TCEM": "thermal expansion, of which the values at the file's temperature are stored",
    "VCUR": "marks a variable", "VDSZ": "marks a variable", "VPAR": "marks a variable",
    "VCON": "marks a variable", "VGLA": "marks a variable",
}  # fmt: skip
"""Words of surfaces that do not change the lens, and why."""

APERTURES_NOT_ROUND = {
    "SQAP": "a rectangular aperture", "SQOB": "a rectangular obscuration",
    "ELAP": "an elliptical aperture", "ELOB": "an elliptical obscuration", "SPID": "a spider",
    "UDAP": "a drawn aperture", "UDOB": "a drawn obscuration", "USAP": "a drawn aperture",
    "UDAD": "the outline of a drawn aperture",
}  # fmt: skip
"""Apertures that are warned about: the semi-diameter is taken instead."""

WORDS_OF_HEAD = {
    "MODE", "NAME", "UNIT", "ENPD", "FNUM", "OBNA", "FLOA", "FTYP", "XFLN", "YFLN", "FWGN",
    "XFLD", "YFLD", "FWGT", "VDXN", "VDYN", "VCXN", "VCYN", "VANN", "ZVDX", "ZVDY", "ZVCX",
    "ZVCY", "ZVAN", "WAVM", "WAVL", "WAVN", "WWGT", "WWGN", "PWAV", "GCAT", "ENVD", "GFAC",
    "MNUM", "MCON",
}  # fmt: skip
"""Words outside of the surfaces that are read."""

WORDS_OF_SURFACES = {
    "TYPE", "CURV", "CONI", "PARM", "DISZ", "GLAS", "DIAM", "MEMA", "CLAP", "FLAP", "OBSC",
    "OBDC", "SCBD", "STOP", "COMM", "COAT", "MAZH", "PZUP", "PPAR",
    "XDAT",
}  # fmt: skip
"""Words of surfaces that are read, those of apertures that are not round apart."""

VALUES = {
    "TYPE": 1, "CURV": 6, "CONI": 1, "PARM": 2, "DISZ": 1, "GLAS": 11, "DIAM": 6, "MEMA": 6,
    "CLAP": 3, "FLAP": 3, "OBSC": 3, "OBDC": 2, "SCBD": 8, "STOP": 0, "MAZH": 2, "PZUP": 4,
    "PPAR": 5,
    "MODE": 1, "UNIT": 7, "ENPD": 2, "FNUM": 2, "OBNA": 2, "FLOA": 2, "FTYP": 7, "WAVM": 3,
    "PWAV": 1, "ENVD": 3, "GFAC": 2, "MNUM": 2,
}  # fmt: skip
"""How many values words have: further ones, unless they say nothing, are warned about.

The others hold text, or as many values as there are fields or wavelengths.
"""

TYPES = {
    "COORDBRK": "a coordinate break", "NONSEQCO": "a non-sequential component",
    "PARAXIAL": "an ideal lens", "PARAX_XY": "an ideal lens", "TILTSURF": "a tilted surface",
    "CYLINDER": "a cylinder", "TOROIDAL": "a toroid", "BICONICX": "a biconic",
    "CONICCYL": "a conic cylinder", "ODDASPHE": "an odd asphere", "XASPHERE": "an asphere",
    "XOSPHERE": "an extended odd asphere", "QED_TYPE": "a Q-type asphere",
    "XPOLYNOM": "a polynomial in x and y", "BINARY_1": "a diffractive surface",
    "BINARY_2": "a diffractive surface", "BINARY_3": "a diffractive surface",
    "DGRATING": "a grating", "HOLOGRM1": "a hologram", "HOLOGRM2": "a hologram",
    "FRESNELS": "a Fresnel lens", "GRINSUR1": "a gradient index", "BIRE_IN": "a birefringent part",
    "BIRE_OUT": "a birefringent part", "SZERNSAG": "a Zernike surface",
    "FZERNSAG": "a Zernike surface", "ZERNSAG": "a Zernike surface", "IRREGULA": "an error of form",
    "GRID_SAG": "a grid of heights", "GRIDPHAS": "a grid of phases",
    "USERSURF": "a surface of the user's program",
}  # fmt: skip
"""What types of surfaces are called, where they cannot be traced."""
