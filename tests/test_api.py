"""The package as others import it: light, typed, and as its examples say."""

import ast
import doctest
import inspect
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import m2t_text

STUB = ast.parse(Path(m2t_text.__file__).with_suffix(".pyi").read_text())
PAGE = Path(__file__).resolve().parents[1] / "docs" / "api.md"
REFERENCE = PAGE.with_name("reference.md")
README = PAGE.parents[1] / "README.md"
EXAMPLES = [
    test
    for name in ["", *m2t_text.__all__]
    for test in doctest.DocTestFinder(exclude_empty=True).find(
        getattr(m2t_text, name) if name else m2t_text, name or "m2t_text", module=False
    )
    if test.examples
]


@pytest.mark.parametrize("test", EXAMPLES, ids=lambda test: test.name)
def test_example(
    test: doctest.DocTest,
    short: Path,
    simulated_index: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each stands for itself, where a log and an index of it lie: as after `m2t-text index drive.log`."""
    shutil.copy(short, tmp_path / "drive.log")
    shutil.copytree(simulated_index, tmp_path / "indexes" / "default")
    monkeypatch.chdir(tmp_path)
    report: list[str] = []
    failed, tried = doctest.DocTestRunner().run(test, out=report.append)
    assert tried and not failed, "".join(report)


def run_page(page: Path) -> int:
    """Runs what a page shows as typed into Python, as one session; returns how many examples there were."""
    shown = "\n".join(re.findall(r"```pycon\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL))
    test = doctest.DocTestParser().get_doctest(shown, {}, page.name, str(page), 0)
    report: list[str] = []
    failed, tried = doctest.DocTestRunner().run(test, out=report.append)
    assert not failed, "".join(report)
    return tried


def test_the_examples_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They need nothing, and make what those of the docstrings need."""
    monkeypatch.chdir(tmp_path)
    assert run_page(PAGE) > 20 and (tmp_path / "indexes" / "default").is_dir()


def test_the_examples_of_the_readme(
    simulated_index: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are plain Whoosh."""
    shutil.copytree(simulated_index, tmp_path / "indexes" / "default")
    monkeypatch.chdir(tmp_path)
    assert run_page(README) >= 6


def test_the_reference_describes_all_names() -> None:
    described = set(re.findall(r"^::: m2t_text\.(\S+)$", REFERENCE.read_text(), re.MULTILINE))
    homes = {
        f"{node.module}.{alias.name}"
        for node in ast.walk(STUB)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    constants, errors = (
        {"config.PROFILES", "sources.public_logs.LOGS"},
        {home for home in homes if home.startswith("errors.")},
    )
    assert homes - constants - errors <= described and "errors" in described


def test_the_stub_lists_all_and_each_is_there_with_its_docstring() -> None:
    """What type checkers read is what runs."""
    imported = [alias.name for node in STUB.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    exported = next(ast.literal_eval(node.value) for node in STUB.body if isinstance(node, ast.Assign))
    assert sorted(imported) == sorted(exported) == sorted(m2t_text.__all__)
    for name in exported:
        thing = getattr(m2t_text, name)
        assert not callable(thing) or len(inspect.getdoc(thing) or "") > 20, name


def test_what_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nothing_such"):
        m2t_text.nothing_such  # noqa: B018


WATCHED = """
import sys
touched = []
WRITES = ("os.mkdir", "os.rename", "os.remove", "os.link", "os.symlink", "os.truncate", "os.chmod", "os.utime")
def watch(event, arguments):
    if event in WRITES or (event == "open" and (set(str(arguments[1])) & set("wxa+") or arguments[2] & 3)):
        touched.append((event, arguments))
sys.addaudithook(watch)
import m2t_text
heavy = {"numpy", "scipy", "numba", "whoosh", "matplotlib", "typer", "rich", "pooch", "requests"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
assert not touched, touched
if len(sys.argv) > 1:
    open(sys.argv[1], "w").close()
    assert touched, "the watch sees nothing"
"""


def test_importing_is_light_and_writes_nothing(tmp_path: Path) -> None:
    line = [sys.executable, "-B", "-c", WATCHED, str(tmp_path / "written")]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_no_second_layer() -> None:
    """Each function of the API is one that the program itself calls."""
    called: set[str] = set()
    names: set[tuple[str, str | None]] = set()  # a command and what it calls may have one name
    for file in Path(m2t_text.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                called.add(node.func.id)
            elif isinstance(node, ast.ImportFrom):
                names |= {(alias.name, alias.asname) for alias in node.names}
    renamed = {name for name, other in names if other in called}
    functions = {name for name in m2t_text.__all__ if inspect.isfunction(getattr(m2t_text, name))}
    assert functions <= called | renamed
