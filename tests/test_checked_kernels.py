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

from query.engine.measures import RayRecords, incidence_angles
from query.engine.scans import Runs, look_up, match_sequence
from raymap.encoding.colors import ColorCodes
from raymap.encoding.detector_crossings import CheckedCrossings, DetectorTable, FoldedCrossings
from raymap.encoding.itineraries import PathRuns
from raymap.encoding.normals import rebuild_normals, rebuild_some_normals
from raymap.encoding.positions import rebuild_positions
from raymap.encoding.shapes import ShapedRecords, compile_shapes, point_shapes
from raymap.model.errors import FormatError
from raymap.model.events import Event
from tests.raymap.maps import small_directory

_ROOT = Path(__file__).resolve().parents[1]
_WITH_KERNELS = ("raymap", "query", "viewer")
_DECORATORS = {"kernel", "lean_kernel", "stage_kernel", "inner_kernel", "inline_kernel"}

_FORMS = {
    "ColorCodes": "codes and paths compared with the table and the sums before each pass",
    "CheckedCrossings": "detectors and cells compared with the directory before each pass",
    "FoldedCrossings": "counts, detectors, positions and residuals compared before they unfold",
    "PathRuns": "numbers and lengths of paths compared with the rows of all rays",
    "ShapedRecords": "shapes and primitives compared with the scene; further columns when called",
    "PathColumns": "of checked dictionaries or compared rays, lengths compared by Context.columns",
    "Runs": "offsets go up from 0, and marks are as many as their last says",
    "RayRecords": "beginnings and lengths of rays compared with the records of the portion",
    "Law": "tables that a law made of numbers which its model has validated, and its own rows",
    "Portion": "the writer: raymap.file.checks has compared every column before it is encoded",
    "itself": "it, or the one function that may call it, compares each index with its array first",
    "called": "called by kernels alone, which stand in this table",
}

_KERNELS = {
    # Laws of surfaces and media
    "frames._fill_axes": ("Law", {"frames.transverse_axes"}),
    "fresnel._fill_reflectance": ("Law", {"fresnel.reflectance_column"}),
    "microfacet_losses._fill_lobe": (
        "Law",
        {"microfacet_losses.conductor_table", "microfacet_losses.dielectric_table"},
    ),
    "amplitudes._amplitudes": (
        "Law",
        {
            "amplitudes._absorbed",
            "amplitudes._lost_facet",
            "amplitudes._meet_facets",
            "amplitudes.meet_waves",
            "amplitudes.shares_of_state",
        },
    ),
    "amplitudes._lost_facet": ("Law", {"amplitudes._meet_facets"}),
    "amplitudes._meet_facets": ("Law", {"amplitudes.meet_waves"}),
    "amplitudes._meet_sheet": ("Law", {"amplitudes.meet_waves"}),
    "amplitudes._scattered": ("Law", {"amplitudes.meet_waves"}),
    "amplitudes.shares_of_state": ("Law", {"carried.meet_smooth_face"}),
    "stacks._fill_shares": ("Law", {"stacks.stack_shares"}),
    "stacks.stack_amplitudes": ("Law", {"amplitudes._amplitudes", "stacks._fill_shares"}),
    "phase.eval_phase": (
        "Law",
        {
            "phase.density",
            "phase.legendre_moments",
            "phase.pdf_phase",
            "pinhole._phase",
            "reweighting._fill_phases",
        },
    ),
    "radial.eval_radial": (
        "Law",
        {
            "likelihoods._around_specular",
            "radial._fill_radial",
            "radial.pdf_radial",
            "specular.around_specular",
        },
    ),
    "radial._fill_radial": ("Law", {"radial._shares"}),
    "rough._fill": ("Law", {"rough.bsdf"}),
    "tabulated.eval_tabulated": (
        "Law",
        {"bsdf.pdf_tabulated", "likelihoods._tabulated", "tabulated.towards_tabulated"},
    ),
    "tabulated.incidence_slice": (
        "Law",
        {"bsdf.sample_tabulated", "tabulated.eval_tabulated", "tabulated.tabulated_share"},
    ),
    "tabulated.tabulated_share": (
        "Law",
        {"bsdf.pdf_tabulated", "tabulated._shares"},
    ),
    "mirror._fill_reflectance": ("Law", {"mirror.metal_shares"}),
    "table._fill_shares": ("Law", {"table.shares_of_tables"}),
    # Rays weighed anew
    "likelihoods._around_specular": ("Law", {"likelihoods._scattered"}),
    "likelihoods._leave": ("Law", {"likelihoods._specular"}),
    "likelihoods._retro": ("Law", {"likelihoods._scattered"}),
    "likelihoods._tabulated": ("Law", {"likelihoods._scattered"}),
    "reweighting._accumulate": ("PathColumns", {"reweighting._along"}),
    "reweighting._fill_phases": ("Law", {"reweighting._phases"}),
    "reweighting._fill_records": ("itself", {"reweighting._records_of"}),
    "reweighting._meet": ("itself", {"reweighting._incidence"}),
    "reweighting._multiply": ("itself", {"reweighting.of_rays"}),
    "crossings._cross": ("itself", {"crossings._found"}),
    "stops._meet_stops": ("itself", {"stops.meet"}),
    "stops._reach_mesh": ("called", {"stops._meet_stops"}),
    "improve._weigh_all": ("itself", {"improve._weigh"}),
    "crossings._cross_sphere": ("called", {"crossings._cross"}),
    # Colours
    "colors.rebuild_codes": ("itself", {"stored._column_color_code"}),
    "colors._color_runs": ("Portion", {"colors.runs_of_codes"}),
    "colors._colors_of_codes": ("ColorCodes", {"colors.colors"}),
    "colors._sum_colors": ("ColorCodes", {"colors.summed"}),
    "colors._sum_weighted_colors": ("ColorCodes", {"colors.summed"}),
    # Crossings and cells
    "cellsums._count": ("CheckedCrossings", {"cellsums.add"}),
    "detector_crossings._cells_fit": ("CheckedCrossings", {"detector_crossings.check"}),
    "detector_crossings._crossing": ("called", {"detector_crossings._decode_crossings"}),
    "detector_crossings._decode_crossings": ("FoldedCrossings", {"detector_crossings.unfold"}),
    # Rays and their paths
    "itineraries.assign_faces": ("itself", {"arrow.faces_of"}),
    "itineraries._expand_points": ("PathRuns", {"itineraries.expand"}),
    "itineraries.face_triangles": ("itself", {"portiongeometry._column_triangle"}),
    "shapes._shape_codes": ("itself", {"shapes.point_shapes"}),
    "shapes._resolve_codes": ("ShapedRecords", {"shapes.check"}),
    "positions._join_coordinates": ("ShapedRecords", {"positions.rebuild_positions"}),
    "positions._solve_positions": ("ShapedRecords", {"positions.rebuild_positions"}),
    "normals._decode_normals": ("ShapedRecords", {"normals.rebuild_normals"}),
    "normals._normals_of_records": ("itself", {"normals.rebuild_some_normals"}),
    "normals._gradient": (
        "called",
        {
            "normals._decode_normals",
            "normals.imply_normals",
            "normals.normal_residuals",
            "normals._normals_of_records",
        },
    ),
    "normals._from_before": (
        "called",
        {"normals._decode_normals", "normals.normal_residuals", "normals.other_residuals"},
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
    "measures._path_lengths": ("RayRecords", {"measures.lengths"}),
    "measures._optical_lengths": ("RayRecords", {"measures.optical_lengths"}),
    "measures._incidence_angles": ("itself", {"measures.incidence_angles"}),
    "scans._look_up": ("itself", {"scans.look_up"}),
    "scans._any_of_run": ("Runs", {"scans.any", "scans.any_before_last"}),
    "scans._count_of_run": ("Runs", {"scans.count"}),
    "scans._offsets_of_runs": ("Runs", {"scans.take"}),
    "scans._rows_of_runs": ("Runs", {"scans.rows"}),
    "scans._match_sequence": ("Runs", {"scans.match_sequence"}),
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
def test_crossings_that_their_detectors_do_not_have(detector, cell):
    table = DetectorTable(np.zeros((1, 11)), np.zeros(1, np.uint8), np.array([[4, 3]]))
    CheckedCrossings.check(np.zeros(1, np.int16), np.array([[3, 2]], np.uint16), table)
    with pytest.raises(FormatError):
        CheckedCrossings.check(np.array(detector, np.int16), np.array(cell, np.uint16), table)


MARKS = np.ones(5, np.bool_)


def test_runs_of_rows():
    runs = Runs.check(np.array([0, 2, 2, 5]))
    assert (len(runs), runs.n_rows) == (3, 5)
    assert runs.count(MARKS).tolist() == [2, 0, 3]
    assert runs.any(MARKS).tolist() == [True, False, True]
    assert runs.take(np.array([2, 0])).offsets.tolist() == [0, 3, 5]
    assert runs.rows(np.array([7, 0, 1])).tolist() == [7, 8, 1, 2, 3]


@pytest.mark.parametrize("offsets", [[], [1, 2], [0, 3, 2], [-1, 0], [0, -1, 5]])
def test_runs_that_do_not_follow_one_another(offsets):
    with pytest.raises(FormatError, match="follow"):
        Runs.check(np.array(offsets, np.int64))


@pytest.mark.parametrize(
    "call",
    [
        lambda runs: runs.any(MARKS[:4]),
        lambda runs: runs.any_before_last(np.ones(6, np.bool_)),
        lambda runs: runs.count(MARKS[:0]),
        lambda runs: runs.take(np.array([0, 3])),
        lambda runs: runs.take(np.array([-1])),
        lambda runs: runs.rows(np.zeros(2, np.int64)),
        lambda runs: match_sequence(runs, None, [(False, MARKS[:3])]),
        lambda runs: match_sequence(runs, runs, [(False, MARKS)]),
        lambda runs: match_sequence(runs, Runs.check(np.arange(6)), [(True, MARKS[:2])]),
        lambda runs: look_up(MARKS, np.array([0, 5])),
    ],
)
def test_scans_of_rows_that_there_are_not(call):
    with pytest.raises(FormatError):
        call(Runs.check(np.array([0, 2, 2, 5])))


PLACES = np.zeros((6, 3), np.float32)


@pytest.mark.parametrize(
    ("position", "starts", "left"),
    [
        (PLACES, [0, 4], [False, False]),
        (PLACES, [-1, 2], [False, False]),
        (PLACES[:4], [0, 2], [False, False]),
        (PLACES, [0], [False]),
        (PLACES, [0, 2], [True]),
        (PLACES[:, :2], [0, 2], [False, False]),
    ],
)
def test_rays_whose_records_there_are_not(position, starts, left):
    points = Runs.check(np.array([0, 2, 5]))
    sound = RayRecords.check(PLACES, np.array([0, 2]), points, np.zeros(2, np.bool_))
    assert sound.lengths().tolist() == [0.0, 0.0]
    with pytest.raises(FormatError):
        RayRecords.check(position, np.array(starts), points, np.array(left))
    one, two = np.zeros(2, np.int32), np.array([0, 3], np.int32)
    channels, index = np.ones((3, 1), np.bool_), np.ones((1, 1))
    assert sound.optical_lengths(np.zeros(5, np.int16), one, channels, index).tolist() == [0, 0]
    for medium, color, n in ((np.zeros(5), two, 1), (np.zeros(4), one, 1), (np.zeros(5), one, 2)):
        with pytest.raises(FormatError):
            sound.optical_lengths(medium.astype(np.int16), color, channels, np.ones((1, n)))


@pytest.mark.parametrize("records", [[0], [6], [-1], [1, 2]])
def test_angles_at_records_that_there_are_not(records):
    with pytest.raises(FormatError):
        incidence_angles(PLACES, np.zeros((1, 3), np.int16), np.array(records))


@pytest.mark.parametrize(
    ("offsets", "numbers", "total"),
    [([0, 2, 3], [0, 2], 5), ([0, 2, 3], [0, 1], 4), ([1, 2], [0], 1), ([0, 2, 1], [0, 1], 1)],
)
def test_rays_of_paths_that_there_are_not(offsets, numbers, total):
    with pytest.raises(FormatError):
        PathRuns.check(np.array(offsets), np.array(numbers, np.uint32), total, "records")


NONE = np.empty(0, np.int32)


def _shaped(triangles=NONE):
    """Two rays of one path: emission, a face of two triangles, a sphere, and out."""
    shapes = compile_shapes(small_directory())
    several = int(np.flatnonzero(shapes.primitive_count > 1)[0])
    sphere = int(np.flatnonzero(shapes.face_code >= 0)[0])
    objects = np.array([-1, 0, 0, -1], np.int16)
    faces = np.array([-1, several, sphere, -1], np.int32)
    events = np.array([1, 0, 0, int(Event.LEFT_SCENE)], np.int32)
    codes = point_shapes(np.array([0, 4]), objects, faces, events, shapes)
    runs = PathRuns.check(np.array([0, 4]), np.zeros(2, np.uint32), 8, "records")
    assert runs.expand(faces).tolist() == 2 * faces.tolist()
    return ShapedRecords.check(runs, codes, triangles, shapes), codes, several


def test_shapes_and_primitives_that_there_are_not():
    records, codes, several = _shaped()
    shapes, runs = records.shapes, records.runs
    first, n = int(shapes.first_primitive[several]), int(shapes.primitive_count[several])
    whole = np.full(8, first, np.int32)
    assert len(_shaped(whole)[0]) == 8
    for wrong in (whole - 1, whole + n, whole[:7]):
        with pytest.raises(FormatError):
            _shaped(wrong)
    for code in (len(shapes.axis), -10 - len(shapes.face_code)):
        with pytest.raises(FormatError):
            ShapedRecords.check(runs, np.full_like(codes, code), whole, shapes)
    with pytest.raises(FormatError):
        ShapedRecords.check(runs, codes[:3], whole, shapes)
    with pytest.raises(FormatError):
        runs.expand(np.zeros(3))
    face = np.array([len(shapes.face_code)], np.int32)
    for faces in (face, face[:0]):
        with pytest.raises(FormatError):
            point_shapes(np.array([0, 1]), np.zeros(1, np.int16), faces, face, shapes)


def test_normals_and_positions_of_other_records():
    records, _, several = _shaped(np.full(8, 1, np.int32))
    sources, places = np.zeros(2, np.int16), np.zeros((8, 3), np.float32)
    folded = (np.zeros(8, np.uint16),) * 3
    assert rebuild_normals(records, sources, 1, places, folded).shape == (8, 3)
    for wrong in (
        (records, sources + 1, 1, places, folded),
        (records, sources[:1], 1, places, folded),
        (records, sources, 1, places[:7], folded),
        (records, sources, 1, places, (folded[0], folded[0], folded[0][:7])),
        (_shaped()[0], sources, 1, places, folded),
    ):
        with pytest.raises(FormatError):
            rebuild_normals(*wrong)
    shapes = records.shapes
    sphere = np.flatnonzero(shapes.face_code >= 0)[:1]
    at = np.array([3])
    assert rebuild_some_normals(shapes, at, sphere, places, folded).shape == (1, 3)
    for wrong_at, face in (
        (at + 5, sphere),
        (at - 4, sphere),
        (at, sphere + len(shapes.face_code)),
        (at, np.array([several])),
        (np.array([1, 2]), sphere),
    ):
        with pytest.raises(FormatError):
            rebuild_some_normals(shapes, wrong_at, face, places, folded)

    def read(name, rows, dtype):
        return np.zeros(8 if rows is None else max(0, rows - missing), dtype)

    for missing in (0, 1):
        with pytest.raises(FormatError, match="fit the paths"):
            rebuild_positions(records, read, solve_faces=True, solve_sphere=not missing)


@pytest.mark.parametrize(
    ("counts", "detector", "records", "residuals"),
    [([1, 1], [0, 1], 2, 2), ([1, 1], [0, -1], 2, 2), ([1, 2], [0, 0], 2, 2),
     ([1, 1], [0, 0], 3, 2), ([1, 1], [0, 0], 2, 1)],
)  # fmt: skip
def test_folded_crossings_that_there_are_not(counts, detector, records, residuals):
    table = DetectorTable(np.ones((1, 11)), np.ones(1, np.uint8), np.array([[4, 3]]))
    with pytest.raises(FormatError):
        FoldedCrossings.check(
            np.array(counts, np.uint16),
            np.array(detector, np.int16),
            np.zeros((records, 3), np.float32),
            np.zeros((5, residuals), np.uint16),
            table,
        )
