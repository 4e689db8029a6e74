"""What the shell is offered for an unfinished word, and ids on narrow terminals."""

import os
import subprocess
from pathlib import Path

import pytest
from calling import PROGRAM, Call

from m2t_text.cli import run


def asked(line: str, index: Path) -> dict[str, str]:
    """The environment in which bash asks for what the end of a command line may be."""
    return {
        "_M2T_TEXT_COMPLETE": "complete_bash",
        "COMP_WORDS": f"m2t-text {line}",
        "COMP_CWORD": str(line.count(" ") + 1),
        "M2T_INDEX": str(index),
    }


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("search dr", ["drive/"]),
        ("search drive/00004", [f"drive/00004{k}" for k in range(10)]),
        ("inspect drive/000040", ["drive/000040"]),
        ("remove d", ["drive"]),
        ("search x", []),
        ("index --profile ", ["default", "paper"]),
    ],
)
def test_ids_datasets_and_profiles_are_offered(
    line: str,
    offered: list[str],
    simulated_index: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name, value in asked(line, simulated_index).items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit):
        run([])
    assert capsys.readouterr().out.split() == offered


def test_nothing_is_offered_of_an_index_that_is_not_there(tmp_path: Path) -> None:
    environment = os.environ | asked("search dr", tmp_path / "none")
    done = subprocess.run(PROGRAM, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, [])


def test_an_id_does_not_break_on_a_narrow_terminal(
    call: Call, simulated_index: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "40")
    status, out, _ = call("search", "drive/000040", "--index", simulated_index, "--top", 1, "--no-verify")
    assert status == 0 and out.count("drive/000040") == 2  # in the title and in the table


def test_an_exclusion_without_effect_is_said(
    call: Call, simulated: Path, simulated_index: Path, tmp_path: Path
) -> None:
    renamed = tmp_path / "monday.log"
    renamed.write_bytes(simulated.read_bytes())
    exclude = ("--index", simulated_index, "--exclude-travel", 10, "--no-verify")
    _, _, err = call("search", f"{renamed}#40", *exclude)
    assert "warning: --exclude-travel leaves nothing out: no dataset 'monday'" in err and "--name" in err
    _, _, err = call("search", f"{renamed}#40", "--name", "drive", *exclude)
    assert "leaves nothing out" not in err
