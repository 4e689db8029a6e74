"""What all tests share."""

import os
from pathlib import Path

import pytest

RADISH = Path(__file__).resolve().parents[2] / "shared" / "data" / "radish"


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
    from m2t_text.logs.simulator import Simulation, simulate, write_carmen

    path = tmp_path_factory.mktemp("logs") / "drive.log"
    write_carmen(simulate(Simulation(seed=3, length=24.0, travel=40.0)), path)
    return path


@pytest.fixture(scope="session")
def simulated_index(simulated: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an index of that drive; not to be changed."""
    from m2t_text.indexing import Request, index_sources

    path = tmp_path_factory.mktemp("indexes") / "drive"
    index_sources(Request([simulated], path))
    return path
