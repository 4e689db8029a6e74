"""Ray is an extra: nothing loads it before a cluster is asked for, and without it that is said in one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from m2t_text.cluster.connection import TOKEN_FILE, own_address, split, token
from m2t_text.errors import ClusterError

LIGHT = """
import sys
from m2t_text.cluster import cluster_index, indexing, node, ray_carrier, remote, running, servers
assert not {"ray", "fsspec"} & set(sys.modules)
sys.modules["ray"] = None
from m2t_text.cli import run
sys.exit(run(sys.argv[1:]))
"""


def test_nothing_loads_it_and_without_it_a_line_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "token").write_text("secret")
    server = subprocess.Popen(
        [sys.executable, "-c", "import socket; s = socket.create_server(('127.0.0.1', 0)); "
         "print(s.getsockname()[1], flush=True); s.accept(); input()"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert server.stdout is not None
    try:
        address = f"127.0.0.1:{server.stdout.readline().strip()}"
        done = subprocess.run(
            [sys.executable, "-c", LIGHT, "search", "a/000001", "--cluster", address],
            env=os.environ | {TOKEN_FILE: str(tmp_path / "token")}, capture_output=True, text=True, check=False,
        )  # fmt: skip
    finally:
        server.communicate("\n")
    assert done.returncode == 2 and "pip install 'm2t-text[cluster]'" in done.stderr, done.stderr


def test_tokens_are_the_users_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "folder" / "token"
    monkeypatch.setenv(TOKEN_FILE, str(file))
    with pytest.raises(ClusterError, match="no token in"):
        token()
    made = token(make=True)
    assert len(made) == 64 and token() == token(make=True) == made and file.stat().st_mode & 0o777 == 0o600
    file.write_text(" \n")
    with pytest.raises(ClusterError, match="is empty"):
        token()


def test_addresses() -> None:
    assert split("localhost:7000") == ("127.0.0.1", 7000) and split("10.0.0.5") == ("10.0.0.5", 6399)
    for wrong in ("", ":1", "host:", "host:99999", "host:x"):
        with pytest.raises(ClusterError, match="is no address"):
            split(wrong)
    with pytest.raises(ClusterError, match=r"no cluster at 127\.0\.0\.1:1 "):
        own_address("127.0.0.1", 1)
