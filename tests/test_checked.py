"""Compiled code gets decoded paths and rays in checked form only: nothing else can make that form.

The forms are `CheckedPaths` (every length and index of a dictionary checked against columns and
directory), `PathDictionary` (the same with sums), `PathRuns` (rays, and the points of their paths),
`ShapedRecords` (of these, what positions and normals are rebuilt from), `RayContext` (rays whose
paths were compared with the portion's own), `PathColumns`, `Runs` and `RayRecords` (of these),
`ColorCodes`, `CheckedCrossings` and `FoldedCrossings`.
"""

from __future__ import annotations

import ast
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
_ROOMS = ("raymap", "query", "tracer", "viewer", "service")
_MADE_IN = {
    "CheckedPaths": {"raymap/encoding/pathstreams.py": ["check_itineraries"]},
    "PathDictionary": {
        # From checked columns
        "raymap/file/portionstreams.py": ["_dictionary"],
        "raymap/file/footer.py": ["read_merged"],
        # From what a tracer handed in, and from dictionaries that were checked
        "raymap/encoding/dictionary.py": ["with_sums"],
        # A checked one, its paths told apart by what they meet besides
        "raymap/passes/placed.py": ["_refined"],
        # A checked one, its paths cut off at stops
        "raymap/passes/stopped.py": ["_paths_of"],
        # The first path of a checked one, to load compiled loops with
        "query/answers/selections/warm.py": ["_first_path"],
    },
    "RayContext": {"query/engine/search.py": ["context"]},
    "PathColumns": {"query/engine/context.py": ["columns"]},
    "ColorCodes": {"raymap/encoding/colors.py": ["check"]},
    "CheckedCrossings": {"raymap/encoding/detector_crossings.py": ["check"]},
    "FoldedCrossings": {"raymap/encoding/detector_crossings.py": ["check"]},
    "PathRuns": {"raymap/encoding/itineraries.py": ["check"]},
    "ShapedRecords": {"raymap/encoding/shapes.py": ["check"]},
    "Runs": {"query/engine/scans.py": ["check"]},
    "RayRecords": {"query/engine/measures.py": ["check"]},
    "MergedPaths": {
        "raymap/file/footer.py": ["read_merged"],
        "raymap/file/shards.py": ["merged"],
        "raymap/file/mixed.py": ["merged"],
        # Other sums of checked paths, whose itineraries stay
        "raymap/passes/revised.py": ["_from_dictionary", "_pass"],
    },
}


def _makers():
    """Type -> file -> functions in which it is constructed."""
    found = {name: {} for name in _MADE_IN}
    for room in _ROOMS:
        for path in sorted((_ROOT / room).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for function in ast.walk(tree):
                if not isinstance(function, ast.FunctionDef):
                    continue
                for node in ast.walk(function):
                    name = getattr(node.func, "id", "") if isinstance(node, ast.Call) else ""
                    if name in found:
                        place = str(path.relative_to(_ROOT))
                        found[name].setdefault(place, []).append(function.name)
    return found


def test_checked_forms_are_made_by_their_validators_alone():
    makers = _makers()
    for name, places in _MADE_IN.items():
        assert makers[name] == places, name


def test_rays_reach_contexts_through_one_comparison():
    """The rows of rays among merged paths are asked of one property, which compares first."""
    source = (_ROOT / "query" / "engine" / "search.py").read_text(encoding="utf-8")
    tree = ast.parse(source)
    [portion_paths] = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef) and node.name == "PortionPaths"
    ]
    [of_ray] = [
        node
        for node in portion_paths.body
        if isinstance(node, ast.FunctionDef) and node.name == "of_ray"
    ]
    calls = [ast.unparse(node.func) for node in ast.walk(of_ray) if isinstance(node, ast.Call)]
    assert calls == ["self.portion.check_rows", "self.portion.compare"]
    # Nobody else indexes a portion's rows among the merged paths by its rays
    for room in ("query", "viewer"):
        for path in sorted((_ROOT / room).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            if path.name != "search.py":
                assert "local[self.numbers]" not in text, path
