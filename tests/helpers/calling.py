"""The command line, called by tests."""

import sys
from collections.abc import Callable

Call = Callable[..., tuple[int, str, str]]  # of the fixture `call`

PROGRAM = [sys.executable, "-c", "from m2t_text.cli import main; main()"]
