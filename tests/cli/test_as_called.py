"""The commands that are printed work as printed, whether or not the program is on the search path."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from m2t_text.cli.console import as_called


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A program in `.venv/bin` of the current folder, as `make` puts it."""
    path = tmp_path / ".venv" / "bin" / "m2t-text"
    path.parent.mkdir(parents=True)
    path.write_text(f"#!{sys.executable}\nfrom m2t_text.cli.console import as_called\nprint(as_called())\n")
    path.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    return path


@pytest.mark.parametrize(
    ("call", "searched", "expected"),
    [
        (".venv/bin/m2t-text", "", ".venv/bin/m2t-text"),
        ("{folder}/.venv/bin/m2t-text", "", ".venv/bin/m2t-text"),
        ("m2t-text", "{folder}/.venv/bin", "m2t-text"),
        (".venv/bin/m2t-text", "{folder}/.venv/bin", "m2t-text"),
    ],
)
def test_the_program_is_named_as_the_shell_finds_it(
    program: Path, tmp_path: Path, call: str, searched: str, expected: str
) -> None:
    path = os.pathsep.join([searched.format(folder=tmp_path), os.defpath])
    environment = os.environ | {"PATH": path, "PYTHONPATH": os.pathsep.join(sys.path)}
    for _ in range(2):  # what it prints can be called in turn
        line = call.format(folder=tmp_path)
        done = subprocess.run(line, shell=True, env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == expected
        call = done.stdout.strip()


def test_a_program_in_a_folder_with_blanks_is_quoted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "my robots"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", os.defpath)
    for argument, expected in [(folder / "m2t-text", "./m2t-text"), (tmp_path / "m2t-text", "../m2t-text")]:
        monkeypatch.setattr(sys, "argv", [str(argument)])
        assert as_called() == expected
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "his robots" / "m2t-text")])
    assert as_called() == "'../his robots/m2t-text'"


def test_a_module_that_runs_is_called_as_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "m2t_text" / "__main__.py")])
    assert as_called().endswith(" -m m2t_text")
    monkeypatch.setattr(sys, "argv", ["pytest"])
    assert as_called() == "m2t-text"
