"""A drive that comes back to places, and its walk."""

from pathlib import Path

import pytest

from m2t_text.logs import Log, read_log
from m2t_text.logs.simulator import Simulation, simulate, write_carmen
from m2t_text.loops.detection import Walk, walk


@pytest.fixture(scope="session")
def circuit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a simulated drive, ``circuit.log``, with ground truth."""
    path = tmp_path_factory.mktemp("circuit") / "circuit.log"
    write_carmen(simulate(Simulation(seed=5, length=24.0, travel=75.0, step=0.25)), path)
    return path


@pytest.fixture(scope="session")
def drive(circuit: Path) -> Log:
    return read_log(circuit)


@pytest.fixture(scope="session")
def walked(drive: Log) -> Walk:
    return walk(drive)
