"""Notebooks run from top to bottom, are kept without outputs, and say the same as their paired scripts."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SCRIPTS = sorted((ROOT / "notebooks").glob("*.py"))


def read(path: Path):
    nbformat = pytest.importorskip("nbformat", reason="needs nbformat: pip install 'jaxrmp[dev]'")
    return nbformat.read(path, as_version=4)


def cells_of(notebook) -> list[tuple[str, str, list[str]]]:
    return [(c.cell_type, c.source, c.metadata.get("tags", [])) for c in notebook.cells]


def test_every_notebook_has_its_script():
    assert NOTEBOOKS and [p.stem for p in NOTEBOOKS] == [p.stem for p in SCRIPTS]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_is_kept_without_outputs(path):
    for cell in read(path).cells:
        assert cell.cell_type == "markdown" or (cell.outputs == [] and cell.execution_count is None)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_and_script_say_the_same(path):
    jupytext = pytest.importorskip("jupytext", reason="needs jupytext: pip install 'jaxrmp[dev]'")
    assert cells_of(read(path)) == cells_of(jupytext.read(path.with_suffix(".py"))), (
        f"{path.name} and its .py differ: jupytext --sync notebooks/{path.name}"
    )


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_ends_in_an_assertion_and_skips_its_installation(path):
    cells = read(path).cells
    assert cells[-1].cell_type == "code" and "\nassert " in "\n" + cells[-1].source
    for cell in cells:
        if cell.source.lstrip().startswith("%pip"):
            assert "skip-execution" in cell.metadata.get("tags", [])


@pytest.mark.notebook
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_runs(path, monkeypatch):
    nbclient = pytest.importorskip("nbclient", reason="needs nbclient: pip install 'jaxrmp[dev]'")
    pytest.importorskip("ipykernel", reason="needs ipykernel: pip install 'jaxrmp[dev]'")
    pytest.importorskip("matplotlib", reason="needs matplotlib: pip install 'jaxrmp[plots]'")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])))
    monkeypatch.setenv("MPLBACKEND", "agg")
    client = nbclient.NotebookClient(
        read(path), timeout=None, skip_cells_with_tag="skip-execution", resources={"metadata": {"path": str(ROOT)}}
    )
    client.execute()
