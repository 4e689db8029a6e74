"""The notebooks run from top to bottom, and show what they showed when they were kept."""

import os
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LOGS = ROOT.parent / "shared" / "data" / "radish"

each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def pictures(notebook: Any) -> list[str]:
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return [output.data["image/png"] for output in outputs if "image/png" in output.get("data", {})]


@pytest.mark.notebook
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@each
def test_notebook(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From where there is nothing else: public logs are in the cache, or there is no network."""
    (tmp_path / "m2t-text").mkdir()
    for log in LOGS.glob("*.log.gz"):
        (tmp_path / "m2t-text" / log.name).symlink_to(log)
    monkeypatch.setenv("XDG_CACHE_HOME", os.fspath(tmp_path))
    monkeypatch.setenv("HTTPS_PROXY", "http://127.0.0.1:9")
    monkeypatch.setenv("IPYTHONDIR", os.fspath(tmp_path))
    notebook = nbformat.read(path, as_version=4)
    kept = len(pictures(notebook))
    NotebookClient(
        notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    ).execute()
    assert len(pictures(notebook)) == kept > 0


@each
def test_what_it_showed_is_kept_and_small(path: Path) -> None:
    """`make notebooks` runs them and keeps it."""
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not any(output.output_type == "error" for cell in code for output in cell.outputs)
    assert pictures(notebook) and path.stat().st_size < 600_000
    assert not any("execution" in cell.metadata for cell in code), "times of this machine"


@each
def test_it_needs_nothing_of_the_tests(path: Path) -> None:
    source = "\n".join(cell.source for cell in nbformat.read(path, as_version=4).cells)
    assert "tests" not in source and "parents[" not in source
