"""A compiled scene: plain tables that compiled code takes, nothing else.

Every table is an array of integers or of numbers with named columns, few enough to hand to a
compiled function. ``C`` is the number of colour channels. A ray's *medium stack* holds the bodies
that it is in (`tracer.transport.medium_stack`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raymap.jit.types import F64, I32, I64

if TYPE_CHECKING:
    from raymap.laws.amplitudes import Amplitudes

# Columns of face_i: kind and shape (`tracer.geometry.kinds`), what a record says of the face, its
# surface, the bodies behind and before its outward normal (-1 none), the blocking detector that
# registers on it (-1 none), event bits of every hit, coordinate axis nearest to its normal
F_KIND, F_OBJECT, F_TRIANGLE, F_SURFACE, F_INSIDE, F_OUTSIDE, F_DETECTOR, F_EVENT, F_AXIS = range(9)

# Columns of surface_i; surface_f holds a parameter row, then reflectance and transmittance (C
# each). Places are in the pool of tables, -1 where there is none
#   model: of a dielectric 0 bare, 1 and 3 a reflectance (3: by channel), 2 a coating
#   scatter, stride: table of scatter about the specular direction, its step per channel (or 0)
#   coating, coating step: table of shares by channel and angle, its step per channel
#   metal: n and k by channel
#   facets: table of a rough surface
#   reflected, transmitted: measured scatter to either side
#   own: numbers of a kind that is described by a law (`tracer.surfaces.law`), and how many
#   aimed: whether scattered light may be aimed: 0 no, 1 on the side of the light, 2 on both
#   meet ... pdf: addresses of compiled functions, 0 until they are known
(
    S_KIND,
    S_MODEL,
    S_SCATTER,
    S_STRIDE,
    S_COATING,
    S_COATING_STEP,
    S_METAL,
    S_FACETS,
    S_REFLECTED,
    S_TRANSMITTED,
    S_OWN,
    S_OWN_SIZE,
    S_AIMED,
    S_MEET,
    S_TOWARDS,
    S_DRAW,
    S_WEIGH,
    S_SAMPLE,
    S_EVALUATE,
    S_PDF,
) = range(20)
S_COLUMNS = 20
SURFACE_ROW = 16

# Columns of medium_i; medium_f holds index, absorption, scattering (C each) [1 / scene unit] and
# the row of the phase function. Participating: 0 clear, 1 alike in all channels, 2 not
M_DISPERSIVE, M_PARTICIPATING = range(2)

# Columns of body_i
B_MEDIUM, B_PRIORITY = range(2)

STACK_BITS, FEW_SOLIDS, WORD_FEW, WORD_MANY = 63, 510, 9, 15
"""Bits of a medium stack (`tracer.transport.medium_stack`); up to so many solids its words have the
first number of bits, else the second."""

# Columns of source_i; source_f: center 0-2, normal 3-5, u 6-8, v 9-11, half sizes or inner and
# outer radius 12-13, cosine that limits the cone 14, direction of a collimated beam 15-17, normal
# in the record 18-20, place in the pool of light 21, tilt of a ring [rad] or half size along the
# axis of a body that shines 22, then the shares of the channels (C)
# Of source_i the last: number of the kind, and addresses of what it emits with, 0 until known
L_AREA, L_DIRECTIONS, L_CODE, L_STACK, L_MEDIUM, L_KIND, L_EMIT, L_TOWARDS = range(8)
L_COLUMNS = 8
SOURCE_ROW = 24

# Columns of detector_i; detector_f: center 0-2, u 3-5, v 6-8, looking direction 9-11, full size
# 12-13, smallest accepted cosine 14, 1 where both sides register 15. Virtual: a plane that light
# passes
# Kind: 0 but for kinds of other distributions, whose function has an address (0 until known)
D_CELLS_U, D_CELLS_V, D_VIRTUAL, D_KIND, D_REGISTER = range(5)
D_COLUMNS = 5

# Entries of limits
DEPTH, WORLD, VIRTUAL, SINGLE = range(4)

# Kinds of surfaces that are built in; numbers of others are made of their words
(
    ABSORBER,
    DIELECTRIC,
    LAMBERTIAN,
    MIRROR,
    ROUGH_DIELECTRIC,
    ROUGH_MIRROR,
    FILTER,
    RETROREFLECTOR,
    TABULATED,
    POLARISER,
    RETARDER,
) = range(11)

# Where a source emits from, and into which directions
FROM_DISC, FROM_RECTANGLE, FROM_POINT, FROM_RING, FROM_PICTURE, FROM_LIST = range(6)
FROM_ELLIPSE, FROM_BOX, FROM_ELLIPSOID = range(6, 9)
# ... cylinders whose axis is u, v or the normal
FROM_CYLINDER_U, FROM_CYLINDER_V, FROM_CYLINDER_N = range(9, 12)
# ... or as a kind of another distribution does (`tracer.sources.source`)
FROM_KIND = 12
COLLIMATED, LAMBERTIAN_CONE, UNIFORM_CONE, BY_TABLE = range(4)


# Columns of Views.numbers: center 0-2, u 3-5, v 6-8, looking direction or axis 9-11, then
#   a far field: lowest and highest gamma [rad] 12-13
#   a camera: radius of its lens 12, 1 / distance of focus 13, tangents of half its field 14-15
#   a flat map of a face: width and height 12-13, side 14 (+1 light from outside, -1 from inside)
#   a map around an axis: lowest and highest place along it 12-13, side 14
#   a map by triangle: first triangle 12, side 14
#   a kind of another distribution: numbers of its own 12-23
VIEW_ROW = 24
NO_VIEW, FAR_FIELD, CAMERA, FLAT_MAP, ROUND_MAP, TRIANGLE_MAP, VIEW_BY_KIND = range(7)


class Views(NamedTuple):
    """Detectors that are no planes: kind (n,) and numbers (n, VIEW_ROW), a row per detector."""

    kind: I64
    numbers: F64


# Entries of VarianceReduction.settings: least probability of a reflection, reflections that split
# light, weight below which rays meet Russian roulette, probability of aiming, most rays of an
# emission
R_LEAST, R_SPLITS, R_FAINT, R_AIM, R_RAYS = range(5)

# Columns of VarianceReduction.targets: shape, center 1-3, normal 4-6, u 7-9, v 10-12, half sizes or
# inner and outer radius 13-14, radius of the bounding sphere 15, 1 where only light towards the
# normal's side counts 16
TARGET_ROW = 17
TARGET_SPHERE, TARGET_RECTANGLE, TARGET_RING = range(3)


class VarianceReduction(NamedTuple):
    """What the weighted mode does differently: its variance reduction.

    settings (5,) : see above
    targets (n, TARGET_ROW) : what scattered light is aimed at
    """

    settings: F64
    targets: F64


class CoincidentFaces(NamedTuple):
    """Faces that may lie on face f: entries first[f] to first[f + 1] of ``face``."""

    first: I64
    face: I64


class Faces(NamedTuple):
    """What the search of the next face needs of a `CompiledScene`, whose fields they are.

    Compiled code for these serves scenes of all kinds.
    """

    face_i: I64
    face_f: F64
    pool: F64 | None
    surface_i: I64
    surface_f: F64
    medium_i: I64
    medium_f: F64
    body_i: I64
    list_of: I64
    first: I64
    face: I64
    distance: F64
    decided: I32
    decides: NDArray[np.uint8]
    plain: NDArray[np.uint8]
    target: I32
    limits: I64


class Carried(NamedTuple):
    """What is needed where rays carry their state of polarisation: in scenes with crystals.

    rows (n_channels, n_bodies + 1, ROW) : media of the bodies, the world last
        (`tracer.optics.crystals.rows`)
    k0 (n_channels,) : 2 pi / wavelength [1 / scene unit]
    vibration (n_sources, 3) : of polarised sources, zero for natural light
    laws : what surfaces do to polarised light
    calls (3,) : addresses of compiled functions (`tracer.transport.carried`), 0 until known
    """

    rows: F64
    k0: F64
    vibration: F64
    laws: Amplitudes
    calls: I64


class CompiledScene(NamedTuple):
    """All that a trace needs.

    face_i (n, 9), face_f (n, 16), pool : analytic faces; half-planes of polygons. ``pool`` is None
        where all faces are flat rings, rectangles, spheres or cylinders
    surface_i, surface_f, medium_i, medium_f, body_i, source_i, source_f, detector_i, detector_f
    pattern : deals ray numbers to sources
    list_of, first, face, distance, decided, decides : candidate lists
        (`tracer.scene.arrangement.candidates`)
    plain, target : faces at which streams of rays are refracted, and the place of the face for
        which those of a list are bound, -1 none (`tracer.transport.streams`)
    tables : flat pool of all sampled functions; None where no medium absorbs or scatters and all
        surfaces absorb, are bare or of constant reflectance, or Lambertian

    The compiler leaves out what None says is not needed: simple scenes start sooner.
    sphere : center and radius of the bounding sphere 0-3, then the corners of the box around all
        virtual detectors, the lowest 4-6, the highest 7-9
    limits : most points of a ray, medium of the world, whether any detector is virtual, whether a
        ray starts in one channel, drawn from its colour
    reduction : settings of the weighted mode; None in the analog one, where the compiler leaves it
        out
    coincident : faces that lie on one another; None where there are none
    light_pool, light_rays : tables of sources (`tracer.sources.light_pool`); None where all are
        plain
    views : detectors that are no planes; None where there are none
    carried : what rays need that carry their polarisation; None where none does
    """

    face_i: I64
    face_f: F64
    pool: F64 | None
    surface_i: I64
    surface_f: F64
    medium_i: I64
    medium_f: F64
    body_i: I64
    source_i: I64
    source_f: F64
    detector_i: I64
    detector_f: F64
    pattern: I64
    list_of: I64
    first: I64
    face: I64
    distance: F64
    decided: I32
    decides: NDArray[np.uint8]
    plain: NDArray[np.uint8]
    target: I32
    tables: F64 | None
    sphere: F64
    limits: I64
    reduction: VarianceReduction | None = None
    coincident: CoincidentFaces | None = None
    light_pool: F64 | None = None
    light_rays: NDArray[np.float32] | None = None
    views: Views | None = None
    carried: Carried | None = None

    @property
    def faces(self) -> Faces:
        """What the search of the next face needs (host only)."""
        return Faces(*(getattr(self, name) for name in Faces._fields))

    @property
    def n_channels(self) -> int:
        """Number of colour channels (host only)."""
        return int(self.source_f.shape[1]) - SOURCE_ROW
