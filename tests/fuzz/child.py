"""Fuzzes one target, in a process of its own: ``child.py TARGET RUNS STATISTICS FINDINGS``.

Coverage guides the mutations: of this package and of those that parse for it. What numba compiles cannot be
watched, and takes no part. What watching takes grows with every input: from ROOM on the process ends with MORE,
and another one goes on with the inputs that it kept.
"""

import json
import logging
import os
import re
import resource
import sys
import tempfile
import time
import warnings
from dataclasses import asdict, dataclass
from hashlib import sha1
from pathlib import Path

import atheris

import m2t_text

SECONDS = 5.0  # of the processor that one input may take
MEMORY = 1 << 30  # bytes that it may take beside what the process has
ROOM = MEMORY // 2  # bytes
MORE = 75  # exit status, as in `fuzz.py`
HANG = 60  # s; a machine with other work is slower
WATCHED = ["m2t_text", "whoosh", "rosbags", "yaml", "PIL"]
COMPILED = re.compile("njit|@kernel|@inner")
TOLD = 100  # runs between two notes


@dataclass
class Statistics:
    """What became of the inputs: those that were read without complaint are ``sound``; times in seconds."""

    runs: int = 0
    sound: int = 0
    seconds: float = 0.0
    slowest: float = 0.0
    megabytes: int = 0  # at the most, of the whole process


def compiled() -> list[str]:
    """The modules with functions that numba compiles."""
    package = Path(m2t_text.__file__).parent
    sources = [file for file in package.rglob("*.py") if COMPILED.search(file.read_text())]
    return [".".join(file.relative_to(package.parent).with_suffix("").parts) for file in sources]


def taken() -> int:
    """Bytes of address space."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def main(name: str, runs: int, statistics: Path, findings: Path) -> None:
    logging.disable()
    warnings.simplefilter("ignore")
    folder, corpus = Path(tempfile.mkdtemp(dir=statistics.parent)), statistics.with_suffix(".corpus")
    corpus.mkdir(exist_ok=True)
    with atheris.instrument_imports(WATCHED, compiled()):
        from targets import TARGETS, tried

        target = TARGETS[name]
        for label, seed in target.seeds(folder).items():
            (corpus / label).write_bytes(seed)
            tried(target, seed, folder)  # also imports and compiles what is needed
    counted = Statistics(**json.loads(statistics.read_text())) if statistics.exists() else Statistics()
    begin, before, most = time.monotonic() - counted.seconds, taken(), runs - counted.runs

    def run(content: bytes) -> None:
        started = time.process_time()
        try:
            refused = tried(target, content, folder)
        except BaseException:
            (findings / f"crash-{sha1(content).hexdigest()}").write_bytes(content)  # as libFuzzer would name it
            raise
        took = time.process_time() - started
        counted.runs += 1
        counted.sound += refused is None
        counted.slowest = max(counted.slowest, took)
        if counted.runs % TOLD == 0 or counted.runs >= runs:
            counted.seconds = time.monotonic() - begin
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
            counted.megabytes = max(counted.megabytes, peak)
            statistics.write_text(json.dumps(asdict(counted)))
        assert took < SECONDS, f"one input took {took:.1f} s"
        if counted.runs % TOLD == 0 and counted.runs < runs and taken() > before + ROOM:
            os._exit(MORE)

    resource.setrlimit(resource.RLIMIT_AS, (before + ROOM + MEMORY, before + ROOM + MEMORY))
    seed = counted.runs + 1  # another one in each process
    options = [
        f"-runs={most}",
        f"-timeout={HANG}",
        f"-seed={seed}",
        "-verbosity=0",
        f"-artifact_prefix={findings}/",
    ]
    atheris.Setup([sys.argv[0], *options, str(corpus)], run)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]), Path(sys.argv[4]))
