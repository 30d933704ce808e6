"""The cells of examples/python/tour.ipynb, in order. Set HYPOGEUM to the binary."""

import importlib.util
import json
import os
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[2] / "examples/python/tour.ipynb"
LIMIT_S = 600

pytestmark = pytest.mark.skipif(not os.environ.get("HYPOGEUM"), reason="HYPOGEUM is not set to the binary")
pytest.importorskip("gymnasium")
pytest.importorskip("matplotlib")
pytest.importorskip("PIL")


def test_notebook_runs_and_has_no_outputs(monkeypatch):
    monkeypatch.chdir(NOTEBOOK.parent)
    cells = [cell for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in cells)
    if all(importlib.util.find_spec(name) for name in ("nbclient", "ipykernel")):
        import nbclient
        import nbformat

        nbclient.NotebookClient(nbformat.read(NOTEBOOK, 4), timeout=LIMIT_S).execute()
        return
    monkeypatch.setenv("MPLBACKEND", "agg")
    names = {}
    for number, cell in enumerate(cells):
        exec(compile("".join(cell["source"]), f"{NOTEBOOK.name}, code cell {number}", "exec"), names)
    assert names["info"]["is_success"][0] and len(names["frames"]) > 1
