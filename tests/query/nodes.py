"""Every node of criteria under one name, for tests."""

from query.atoms.all import All
from query.atoms.angle_of_polarisation import AngleOfPolarisation
from query.atoms.bounces import Bounces
from query.atoms.count import Count
from query.atoms.crossed import Crossed
from query.atoms.crosses import Crosses
from query.atoms.degree_of_polarisation import DegreeOfPolarisation
from query.atoms.detected import Detected
from query.atoms.event import EventAt
from query.atoms.flux import Flux
from query.atoms.hit import Hit
from query.atoms.incidence import Incidence
from query.atoms.last import Last
from query.atoms.length import Length
from query.atoms.medium import Medium
from query.atoms.optical_length import OpticalLength
from query.atoms.optical_path import OpticalPath
from query.atoms.path import Path
from query.atoms.source import Source
from query.atoms.time import Time
from query.atoms.wavelength import Wavelength
from query.engine.recorded import Recorded
from query.expression.arguments import Region, SurfaceTest
from query.expression.atom import Compare, Quantity
from query.expression.criterion import And, Criterion, Not, Or, Then, Xor
from query.expression.words import EventSet

__all__ = [
    "All",
    "And",
    "AngleOfPolarisation",
    "Bounces",
    "Compare",
    "Count",
    "Criterion",
    "Crossed",
    "Crosses",
    "DegreeOfPolarisation",
    "Detected",
    "EventAt",
    "EventSet",
    "Flux",
    "Hit",
    "Incidence",
    "Last",
    "Length",
    "Medium",
    "Not",
    "OpticalLength",
    "OpticalPath",
    "Or",
    "Path",
    "Quantity",
    "Recorded",
    "Region",
    "Source",
    "SurfaceTest",
    "Then",
    "Time",
    "Wavelength",
    "Xor",
]
