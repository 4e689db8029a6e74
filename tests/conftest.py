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
