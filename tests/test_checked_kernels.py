"""Every compiled loop that takes an index from an array: who has checked it, and who may call it.

Found in the source: the kernels, and the parameters whose stored values reach an index, the bound
of a loop, or another kernel. Each of these kernels stands in the table below, with the form in
which its indices are checked and the only functions that may refer to it.
"""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from raymap.encoding.colors import ColorCodes
from raymap.encoding.meetings import CheckedMeetings, DetectorTable
from raymap.model.errors import FormatError

_ROOT = Path(__file__).resolve().parents[1]
_WITH_KERNELS = ("raymap", "query", "viewer")
_DECORATORS = {"kernel", "lean_kernel", "stage_kernel", "inner_kernel", "inline_kernel"}

_FORMS = {
    "ColorCodes": "codes and paths compared with the table and the sums before each pass",
    "CheckedMeetings": "detectors and cells compared with the directory before each pass",
    "CheckedPaths": (
        "lengths, indices and faces of paths, path numbers, records and meetings of rays are "
        "checked by PortionStreams and PortionGeometry, whose methods alone decode"
    ),
    "PathColumns": "made by Context.columns from checked dictionaries or compared rays",
    "Context": "columns of a PathContext (checked dictionary) or RayContext (compared rays)",
    "Law": "tables that a law made of numbers which its model has validated, and its own rows",
    "Portion": "the writer: raymap.file.checks has compared every column before it is encoded",
    "itself": "the loop compares each index with its array before it uses it",
    "called": "called by kernels alone, which stand in this table",
}

_KERNELS = {
    # Laws of surfaces and media
    "frames._fill_axes": ("Law", {"frames.transverse_axes"}),
    "fresnel._fill_reflectance": ("Law", {"fresnel.reflectance_column"}),
    "phase.eval_phase": (
        "Law",
        {"phase.density", "phase.legendre_moments", "phase.pdf_phase", "pinhole._phase"},
    ),
    "radial.eval_radial": (
        "Law",
        {"radial._shares", "radial.pdf_radial", "specular.around_specular"},
    ),
    "tabulated.eval_tabulated": ("Law", {"bsdf.pdf_tabulated", "tabulated.towards_tabulated"}),
    "tabulated.incidence_slice": (
        "Law",
        {"bsdf.sample_tabulated", "tabulated.eval_tabulated", "tabulated.tabulated_share"},
    ),
    "tabulated.tabulated_share": (
        "Law",
        {"bsdf.pdf_tabulated", "tabulated.sample_measured", "tabulated.shares"},
    ),
    # Colours
    "colors.rebuild_codes": ("itself", {"stored._column_color_code"}),
    "colors._color_runs": ("Portion", {"colors.runs_of_codes"}),
    "colors._colors_of_codes": ("ColorCodes", {"colors.colors"}),
    "colors._sum_colors": ("ColorCodes", {"colors.summed"}),
    "colors._sum_weighted_colors": ("ColorCodes", {"colors.summed"}),
    # Meetings and cells
    "cellsums._count": ("CheckedMeetings", {"cellsums.add"}),
    "meetings._cells_fit": ("CheckedMeetings", {"meetings.check"}),
    "meetings._crossing": ("called", {"meetings.decode_meetings"}),
    "meetings.decode_meetings": ("CheckedPaths", {"portiongeometry._crossings"}),
    # Rays and their paths
    "itineraries.assign_faces": ("itself", {"arrow.faces_of"}),
    "itineraries.expand_points": (
        "CheckedPaths",
        {"portionstreams._expand", "portionstreams._meetings"},
    ),
    "itineraries.face_triangles": ("CheckedPaths", {"portiongeometry._column_triangle"}),
    "shapes.shape_codes": (
        "CheckedPaths",
        {"portiongeometry._shape_codes", "geometrystreams._shape_codes"},
    ),
    "positions.resolve_codes": (
        "CheckedPaths",
        {"portiongeometry._shape_codes", "geometrystreams._shape_codes"},
    ),
    "positions.join_coordinates": ("CheckedPaths", {"portiongeometry._positions"}),
    "positions.solve_positions": ("CheckedPaths", {"portiongeometry._positions"}),
    "normals.decode_normals": ("CheckedPaths", {"portiongeometry._normals"}),
    "normals.normals_of_records": ("CheckedPaths", {"portiongeometry.normals_at"}),
    "normals._gradient": (
        "called",
        {
            "normals.decode_normals",
            "normals.imply_normals",
            "normals.normal_residuals",
            "normals.normals_of_records",
        },
    ),
    "normals._from_before": (
        "called",
        {"normals.decode_normals", "normals.normal_residuals", "normals.other_residuals"},
    ),
    # The writer
    "normals.imply_normals": ("Portion", {"geometrystreams.with_normals"}),
    "normals.normal_residuals": ("Portion", {"geometrystreams._add_normals"}),
    "normals.end_residuals": ("Portion", {"geometrystreams._add_unlike_normals"}),
    "normals.other_residuals": ("Portion", {"geometrystreams._add_unlike_normals"}),
    "pathwords.name_faces": ("Portion", {"dictionary.itineraries_of"}),
    "pathwords.number_rays": ("Portion", {"dictionary._number_all", "dictionary.add"}),
    "pathwords.enter_hashes": ("Portion", {"dictionary._make_room"}),
    "pathwords.write_paths": ("Portion", {"dictionary._unpacked"}),
    "pathwords._code_of": ("called", {"pathwords.name_faces", "pathwords.number_rays"}),
    "pathwords._face_code": ("called", {"pathwords._code_of"}),
    # Questions
    "illumination._lights": ("PathColumns", {"illumination.labels"}),
    "path_keys._keys": ("PathColumns", {"path_keys._new_keys"}),
    "path_matching.match_path": ("PathColumns", {"path.run"}),
    "path_matching._fits": ("called", {"path_matching.match_path"}),
    "path_matching._register_each": ("called", {"path_matching.match_path"}),
    "path_matching._register_any": ("called", {"path_matching.match_path"}),
    "measures.path_lengths": ("Context", {"length.values"}),
    "measures.optical_lengths": ("Context", {"optical_length.values"}),
    "measures.incidence_angles": ("Context", {"incidence.on_rays"}),
    "scans.look_up": (
        "Context",
        {
            "detected.on_meetings",
            "hit._places",
            "medium.on_rays",
            "search.spread",
            "source.on_rays",
        },
    ),
    "scans.any_of_ray": (
        "Context",
        {"bound.on_rays", "bound.some_point", "incidence.on_rays", "recorded.on_rays"},
    ),
    "scans.any_before_last": ("Context", {"medium.on_rays"}),
    "scans.count_of_ray": ("Context", {"count.on_rays", "ghosts._reflecting"}),
    "scans.ray_offsets": ("Context", {"context.offsets", "incidence._surface_points"}),
    "scans.expand_rows": (
        "Context",
        {
            "context._base_meetings",
            "context.descriptor_rows",
            "context.records",
            "context.rows",
            "incidence._surface_points",
        },
    ),
    "scans.match_sequence": ("Context", {"logic.run"}),
    # Pictures: rows of triangles come from a sort, coordinates are cut at the picture's edges
    "fill._fill_band": ("itself", {"fill.fill_triangles"}),
    "raster._draw_band": ("itself", {"raster.draw_segments"}),
}


def _trees(rooms):
    for room in rooms:
        for path in sorted((_ROOT / room).rglob("*.py")):
            yield path.stem, ast.parse(path.read_text(encoding="utf-8"))


def _kernels():
    """Module.function -> the syntax tree of each compiled function."""
    return {
        f"{module}.{node.name}": node
        for module, tree in _trees(_WITH_KERNELS)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and {getattr(one, "id", "") for one in node.decorator_list} & _DECORATORS
    }


def _indexing(function, kernels):
    """Parameters whose stored values reach an index, a bound of a loop or another kernel."""
    known = {one.arg: set() for one in function.args.args}
    alias = {}

    def held(expression):
        found = set()
        for node in ast.walk(expression):
            if isinstance(node, ast.Subscript):
                base = node.value
                while isinstance(base, ast.Attribute | ast.Subscript):
                    base = base.value
                name = getattr(base, "id", "")
                shape = isinstance(node.value, ast.Attribute) and node.value.attr == "shape"
                if (name in known or name in alias) and not shape:
                    found.add(alias.get(name, name))
            if isinstance(node, ast.Name):
                found |= known.get(node.id, set())
        return found

    for _ in range(5):
        for node in ast.walk(function):
            if isinstance(node, ast.Assign | ast.AugAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                values = held(node.value)
                names = [n for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
                plain = [n for n in names if isinstance(n.ctx, ast.Store)]
                for name in plain:
                    known.setdefault(name.id, set()).update(values)
                owner = getattr(getattr(node.value, "value", None), "id", "")
                if isinstance(node.value, ast.Attribute) and owner in known:
                    alias.update((name.id, owner) for name in plain)
            elif isinstance(node, ast.For):
                known.setdefault(node.target.id, set()).update(held(node.iter))
    used = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Subscript):
            used |= held(node.slice)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in {*kernels, "range"}:
            used |= {name for argument in node.args for name in held(argument)}
    return used


def _references(kernels):
    """Kernel -> the functions that name it, wherever they lie."""
    found = {}
    for module, tree in _trees((*_WITH_KERNELS, "tracer", "service")):
        known = {key.split(".")[1]: key for key in kernels if key.split(".")[0] == module}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                for one in node.names:
                    key = f"{(node.module or '').split('.')[-1]}.{one.name}"
                    if key in kernels:
                        known[one.asname or one.name] = key

        def visit(node, place, module=module, known=known):
            for child in ast.iter_child_nodes(node):
                inner = child.name if isinstance(child, ast.FunctionDef) else place
                if isinstance(child, ast.Name) and child.id in known:
                    found.setdefault(known[child.id], set()).add(f"{module}.{inner}")
                visit(child, inner)

        visit(tree, "")
    return found


def test_every_kernel_that_indexes_is_listed_with_its_form_and_its_callers():
    kernels = _kernels()
    names = {key.split(".")[1] for key in kernels}
    indexing = {key for key, function in kernels.items() if _indexing(function, names)}
    assert len(kernels) > 70
    assert indexing == set(_KERNELS)
    references = _references(kernels)
    for key, (form, callers) in _KERNELS.items():
        assert references.get(key, set()) == callers, key
        assert form in _FORMS, key
        if form == "called":
            assert callers <= set(kernels), key


def test_the_search_for_indices_sees_what_it_must():
    """Values that reach an index by a name, a sum, a loop's bound, a field; not other arrays."""
    source = """
def f(codes, table, offsets, paths, weight, out):
    rows = paths.rows
    for i in range(offsets[3]):
        code = codes[i] + 1
        out[i] = table[code, rows[i]] * weight[i]
"""
    [function] = ast.parse(source).body
    assert _indexing(function, set()) == {"codes", "offsets", "paths"}


@pytest.mark.parametrize("codes", [[-1], [0, 5], [2**31 - 1]])
def test_codes_that_the_table_does_not_have(codes):
    table = np.zeros((2, 3), np.uint16)
    assert ColorCodes.check(np.array([0, 4], np.int32), table).colors().shape == (2, 3)
    with pytest.raises(FormatError, match="not in the colour table"):
        ColorCodes.check(np.array(codes, np.int32), table)


def test_sums_of_colours_ask_where_they_go():
    codes = ColorCodes.check(np.array([0, 1], np.int32), np.empty((0, 3), np.uint16))
    numbers = np.array([0, 1], np.uint32)
    assert codes.summed(numbers, None, 2).tolist() == [[65535, 0, 0], [0, 65535, 0]]
    for wrong, weight, n_paths in (
        (numbers, None, 1),
        (numbers[:1], None, 2),
        (numbers, np.ones(1, np.float32), 2),
    ):
        with pytest.raises(FormatError):
            codes.summed(wrong, weight, n_paths)


@pytest.mark.parametrize(
    ("detector", "cell"),
    [([1], [[0, 0]]), ([-1], [[0, 0]]), ([0], [[4, 0]]), ([0], [[0, 3]]), ([0, 0], [[0, 0]])],
)
def test_meetings_that_their_detectors_do_not_have(detector, cell):
    table = DetectorTable(np.zeros((1, 11)), np.zeros(1, np.uint8), np.array([[4, 3]]))
    CheckedMeetings.check(np.zeros(1, np.int16), np.array([[3, 2]], np.uint16), table)
    with pytest.raises(FormatError):
        CheckedMeetings.check(np.array(detector, np.int16), np.array(cell, np.uint16), table)
