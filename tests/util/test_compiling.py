"""Where compiled kernels are kept, also where next to nothing can be written, and what makes them stale."""

from pathlib import Path

import numba
import pytest

from m2t_text.util import compiling


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with one kernel, the user's caches, and no setting."""
    folder = tmp_path / "package"
    (folder / "mapping").mkdir(parents=True)
    (folder / "mapping" / "inner.py").write_text("first")
    monkeypatch.setattr(compiling, "PACKAGE", folder)
    monkeypatch.setattr(compiling, "_user_caches", lambda: tmp_path / "caches")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    return folder


def folder() -> tuple[Path, bool]:
    return compiling._folder.__wrapped__()


def closed(path: Path) -> None:
    """Makes a folder impossible, for root as well."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("a file")


def test_kernels_are_kept_beside_the_package_then_among_the_users_caches(package, tmp_path):
    assert folder()[0].parent == package / "__pycache__"
    (package / "__pycache__").rmdir()
    closed(package / "__pycache__")
    assert folder() == (tmp_path / "caches" / folder()[0].name, True)


def test_the_setting_comes_first(package, tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "chosen"))
    assert folder()[0].parent == tmp_path / "chosen"


@pytest.mark.parametrize("home", ["closed", "none"])
def test_without_any_folder_a_temporary_one_is_used(package, tmp_path, monkeypatch, home):
    closed(package / "__pycache__")
    if home == "closed":
        closed(tmp_path / "caches")
    else:
        monkeypatch.setattr(compiling, "_user_caches", lambda: Path("~/.cache/m2t-text"))
    removed = []
    monkeypatch.setattr(compiling.atexit, "register", lambda *call: removed.append(call))
    place, kept = folder()
    assert not kept and place.parent.is_dir() and place.parent.stat().st_mode & 0o77 == 0
    ((remove, *arguments),) = removed
    remove(*arguments)
    assert not place.parent.exists()


def test_what_was_compiled_beside_a_package_that_is_read_only_now_is_used(package, tmp_path, monkeypatch):
    beside = folder()[0]
    (beside / "kernel").mkdir(parents=True)
    (beside / "kernel" / "code.nbc").write_text("machine code")
    monkeypatch.setattr(compiling, "_can_write", lambda place: place == tmp_path / "caches")
    (tmp_path / "caches").mkdir()
    place, kept = folder()
    assert kept and (place / "kernel" / "code.nbc").read_text() == "machine code"


def test_an_edited_inner_kernel_makes_all_stale(package):
    before = folder()[0]
    before.mkdir()
    (package / "mapping" / "inner.py").write_text("second")
    after = folder()[0]
    assert after != before and not before.exists()


def test_all_compiled_functions_lie_in_the_folders_that_are_looked_at():
    root = Path(compiling.__file__).parents[1]
    marks = ("\n@kernel", "\n@inner", "\n@inlined", "njit(")
    found = {
        file.parent.relative_to(root).as_posix()
        for file in root.rglob("*.py")
        if any(mark in file.read_text() for mark in marks)
    }
    assert found - {"util"} == set(compiling.COMPILED)
