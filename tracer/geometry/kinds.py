"""Kinds of analytic faces and their parameter rows, shared by compiled loops and compilers.

A face is a kind and a row of `ROW` numbers [scene units]:

========== ======================================================================================
kind       row
========== ======================================================================================
ANNULUS    origin 0-2, normal 3-5, inner radius² 6, outer radius² 7
RECTANGLE  origin 0-2, normal 3-5, u 6-8, v 9-11, half width 12, half height 13
POLYGON    origin 0-2, normal 3-5, first row of the pool 6, count of rows 7; a pool row (m, c)
           keeps the half-plane m . p <= c
SPHERE     vertex 0-2, axis from vertex to centre 3-5, radius 6, sag of the edge 7, side/radius 8
CYLINDER   origin 0-2, axis 3-5, radius 6, from 7, to 8 (along the axis), side 9
CONE       origin 0-2, axis 3-5, radius at the origin 6, slope 7, from 8, to 9, side 10
CONIC      vertex 0-2, axis 3-5, curvature 6, 1 + conic constant 7, outer radius² 8, side 9,
           inner radius² 10 (-1: no hole)
ASPHERE    as CONIC, then coefficients of r^4, r^6 … r^14 in 10-15
MESH       a named face of a triangle mesh: no row; Embree finds its triangles
others     origin 0-2, axes u 3-5 and v 6-8, first of its numbers in the pool 9, count of them 10,
           addresses of its functions 14, 15 (`tracer.geometry.other_shapes`); kinds from
           FIRST_OTHER on
========== ======================================================================================

``side`` is +1 where the outward normal points away from the centre or axis (for CONIC and ASPHERE:
against the axis), -1 where it points towards it.
"""

from __future__ import annotations

__all__ = [
    "ANNULUS",
    "ASPHERE",
    "CONE",
    "CONIC",
    "CYLINDER",
    "FIRST_OTHER",
    "HIT_ADDRESS",
    "NORMAL_ADDRESS",
    "POLYGON",
    "RECTANGLE",
    "MESH",
    "ROW",
    "SPHERE",
]

ROW = 16
ANNULUS = 0
RECTANGLE = 1
POLYGON = 2
SPHERE = 3
CYLINDER = 4
CONE = 5
CONIC = 6
ASPHERE = 7
MESH = 8
FIRST_OTHER = 1 << 20
HIT_ADDRESS = 14
NORMAL_ADDRESS = 15
