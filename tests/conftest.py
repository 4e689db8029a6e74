"""What all tests share."""

import io
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from calling import Call
from hypothesis import settings

if TYPE_CHECKING:
    from m2t_text.logs import Log
    from m2t_text.loops.detection import LoopDetection

# The same examples on every machine; `pytest --hypothesis-profile=default` looks for others.
settings.register_profile("same", derandomize=True, deadline=None, max_examples=50)
settings.load_profile("same")

if "PYTEST_XDIST_WORKER" in os.environ:  # each core has its own worker, which therefore needs no threads
    os.environ["M2T_THREADS"] = "1"

# Under nohup the commands that tests start would ignore Ctrl-C as well.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

RADISH = Path(__file__).resolve().parents[2] / "shared" / "data" / "radish"


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """Compiles what was not compiled on this machine, so that no command of a test says that it does."""
    from m2t_text.util.compiled import Group, missing
    from m2t_text.warming import warm

    if missing(Group):
        warm(missing(Group))


@pytest.fixture(scope="session")
def radish() -> Path:
    """The folder of the real laser logs; without it the test is skipped, but fails where CI is set."""
    if not RADISH.is_dir():
        message = f"the real logs are not in {RADISH}"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    return RADISH


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a short simulated drive, ``drive.log``."""
    from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen

    path = tmp_path_factory.mktemp("logs") / "drive.log"
    write_carmen(simulate(Simulation(seed=3, length=24.0, travel=40.0)), path)
    return path


@pytest.fixture(scope="session")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of the first dozen metres of such a drive, also ``drive.log``."""
    from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen

    path = tmp_path_factory.mktemp("short") / "drive.log"
    write_carmen(simulate(Simulation(seed=3, length=24.0, travel=12.0)), path)
    return path


@pytest.fixture(scope="session")
def simulated_index(simulated: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an index of that drive; not to be changed."""
    from m2t_text.sources.indexing import IndexRequest, index_sources

    path = tmp_path_factory.mktemp("indexes") / "drive"
    index_sources(IndexRequest([simulated], path))
    return path


@pytest.fixture(scope="session")
def circuit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a simulated drive that comes back to places, ``circuit.log``, with ground truth."""
    from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen

    path = tmp_path_factory.mktemp("circuit") / "circuit.log"
    write_carmen(simulate(Simulation(seed=12, length=24.0, travel=42.0, step=0.3)), path)
    return path


@pytest.fixture(scope="session")
def drive(circuit: Path) -> "Log":
    from m2t_text.logs import read_log

    return read_log(circuit)


@pytest.fixture(scope="session")
def detection(drive: "Log") -> "LoopDetection":
    from m2t_text.loops.detection import detect_loops

    return detect_loops(drive)


@pytest.fixture
def two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads share the work of a search, as they do where a process may take several cores."""
    monkeypatch.setenv("M2T_THREADS", "2")


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to be in, with nothing of the program in the environment."""
    monkeypatch.chdir(tmp_path)
    for name in [name for name in os.environ if name.startswith("M2T_") and name != "M2T_THREADS"]:
        monkeypatch.delenv(name)
    return tmp_path


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Call:
    """Runs one command line: (exit status, standard output, standard error)."""
    from m2t_text.cli import run

    def call(*arguments: object, stdin: str = "") -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin.encode())))
        status = run([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return status, out, err

    return call
