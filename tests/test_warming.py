"""What is compiled beforehand is what commands need, and whoever waits is told."""

import subprocess
import sys

import pytest

from m2t_text.cli import compiling as cli_compiling
from m2t_text.util import compiled, compiling
from m2t_text.util.compiled import Group, compile_once, missing

SIGNATURES = """
import importlib, pkgutil, sys
from numba.core.dispatcher import Dispatcher
import m2t_text as m2t
from m2t_text.util.compiling import COMPILED, KernelCache
from m2t_text.warming import STEPS

def compiled(cache=object):
    found = {}
    for name, module in list(sys.modules.items()):
        for one in vars(module).values() if name.startswith("m2t_text.") else ():
            if isinstance(one, Dispatcher) and isinstance(one._cache, cache):
                found[f"{one.py_func.__module__}.{one.py_func.__name__}"] = set(one.signatures)
    return found

for steps in STEPS.values():
    for step in steps:
        step()
before = compiled()
for profile in ("default", "paper"):
    index = m2t.MapIndex.create(f"{sys.argv[1]}/{profile}", m2t.PROFILES[profile])
    log = m2t.simulate(m2t.Simulation(length=24.0, travel=9.0))
    index.add(m2t.LogSource(log))
    query = m2t.Query.of(m2t.describe_at(log, 3, index.parameters))
    assert m2t.find(index, query, top=3).results
    index.search(query.text, method="bow")
after = compiled()
late = {name: after[name] - before.get(name, set()) for name in after if after[name] - before.get(name, set())}
for folder in COMPILED:
    package = importlib.import_module("m2t_text." + folder.replace("/", "."))
    for module in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)
never = [name for name, signatures in compiled(KernelCache).items() if not signatures]
assert len(before) > 15, before
print(late, never)
"""


def test_a_command_compiles_nothing_that_was_not_compiled_beforehand_and_no_kernel_is_left_out(tmp_path):
    command = [sys.executable, "-c", SIGNATURES, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "{} []\n"


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """An empty folder for kernels."""
    monkeypatch.setattr(compiled, "kernel_folder", lambda: tmp_path)
    return tmp_path


def test_a_group_is_compiled_once_and_progress_is_told(kernels):
    ran, told = [], []
    steps = [lambda: ran.append(1), lambda: ran.append(2)]
    assert missing([Group.AGREEMENT]) == [Group.AGREEMENT]
    compile_once(Group.AGREEMENT, steps, told.append)
    assert ran == [1, 2] and told == [0, 1, 2, 2]
    assert Group.AGREEMENT not in missing(Group) and len(missing(Group)) == len(Group) - 1
    compile_once(Group.AGREEMENT, steps, told.append)
    assert ran == [1, 2]


def test_a_step_that_fails_leaves_the_group_to_be_compiled(kernels):
    def fail() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compile_once(Group.AGREEMENT, [fail], lambda done: None)
    assert missing([Group.AGREEMENT]) == [Group.AGREEMENT]
    assert [file.name for file in kernels.iterdir()] == ["agreement.lock"]


def test_who_comes_second_waits_for_the_first_and_hears_how_far_it_is(kernels, monkeypatch):
    told = []

    class Held:
        """A lock that another process holds, which then ends with all compiled."""

        def __init__(self, path: str) -> None:
            self.refused = 0

        def acquire(self) -> bool:
            if self.refused == 0:
                (kernels / "agreement.steps").write_text("3")
            else:
                compiled._ready(Group.AGREEMENT).touch()
            self.refused += 1
            return self.refused > 1

        def release(self) -> None:
            pass

    monkeypatch.setattr(compiled, "FileLock", Held)
    monkeypatch.setattr(compiled, "sleep", lambda seconds: None)
    compile_once(Group.AGREEMENT, [pytest.fail] * 4, told.append)
    assert told == [0, 3, 4]


@pytest.mark.parametrize(("kept", "line"), [(True, cli_compiling.ONCE), (False, cli_compiling.NEVER_KEPT)])
def test_who_waits_is_told_in_one_line(kernels, monkeypatch, capsys, kept, line):
    monkeypatch.setattr("m2t_text.warming.STEPS", dict.fromkeys(Group, ()))
    monkeypatch.setattr(compiling, "are_kept", lambda: kept)
    cli_compiling.compile_first([Group.AGREEMENT])
    cli_compiling.compile_first([Group.AGREEMENT])
    assert capsys.readouterr().err == f"{line}\n"


def test_the_process_beside_compiles_what_is_missing_and_holds_no_pipe_of_its_parent(kernels, monkeypatch):
    started = []
    monkeypatch.setattr(
        cli_compiling.subprocess, "Popen", lambda command, **how: started.append((command, how))
    )
    cli_compiling.compile_beside([Group.AGREEMENT])
    ((command, how),) = started
    assert command[-2:] == ["--beside", "agreement"] and how["start_new_session"]
    assert {how[stream] for stream in ("stdin", "stdout", "stderr")} == {subprocess.DEVNULL}
    monkeypatch.setattr(compiling, "are_kept", lambda: False)
    cli_compiling.compile_beside([Group.AGREEMENT])
    assert len(started) == 1
