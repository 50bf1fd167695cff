"""The application inside a real notebook kernel."""

from __future__ import annotations

import re

import nbformat
import pytest
from nbclient import NotebookClient

_CELLS = (
    "import urllib.request, raymap, viewer\nlens = raymap.open({path!r})\napp = viewer.view(lens)",
    "print(urllib.request.urlopen(app.url).status)",
    "app.stop()\nprint('stopped')",
)


@pytest.mark.browser
def test_a_notebook_shows_the_application_inline(map_path):
    cells = [nbformat.v4.new_code_cell(source.format(path=str(map_path))) for source in _CELLS]
    notebook = nbformat.v4.new_notebook(cells=cells)
    done = NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    shown = [output.data["text/html"] for output in done.cells[0].outputs if "data" in output]
    address = r'<iframe[^>]+src="http://localhost:\d+/'
    assert any(re.search(address, html, re.DOTALL) for html in shown)
    assert done.cells[1].outputs[-1].text.strip() == "200"
    assert done.cells[2].outputs[-1].text.strip() == "stopped"
