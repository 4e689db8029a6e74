"""Public logs: downloaded once, checked, and never half there; all from a server on this machine."""

import hashlib
import json
import resource
import signal
import socket
import stat
import subprocess
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Event, Thread

import pytest
from calling import PROGRAM, Call

from m2t_text.sources import public_logs
from m2t_text.sources.public_logs import LOGS, PublicLog, fetch

pytestmark = pytest.mark.usefixtures("own_folder")

NAME = "here/drive"


class Mirror(ThreadingHTTPServer):
    """Serves one log, and the same from folders where something goes wrong."""

    daemon_threads = True

    def __init__(self, contents: bytes) -> None:
        super().__init__(("127.0.0.1", 0), Answer)
        self.contents = contents
        self.asked: list[str] = []
        self.half_sent, self.given_up = Event(), Event()

    def url(self, folder: str) -> str:
        return f"http://127.0.0.1:{self.server_port}/{folder}"


class Answer(BaseHTTPRequestHandler):
    server: Mirror

    def do_GET(self) -> None:
        folder, contents = self.path.split("/")[1], self.server.contents
        self.server.asked.append(self.path)
        if folder == "missing":
            self.send_error(404)
            return
        if folder == "broken":
            self.send_error(503)
            return
        if folder == "silent":
            self.server.given_up.wait(20)
            return
        self.send_response(200)
        if folder != "endless":
            self.send_header("Content-Length", str(len(contents)))
        self.end_headers()
        if folder in ("cut", "stalled"):
            self.wfile.write(contents[: len(contents) // 2])
            self.server.half_sent.set()
            if folder == "stalled":
                self.server.given_up.wait(20)
        else:
            self.wfile.write(contents if folder != "changed" else contents[::-1])

    def log_message(self, *arguments: object) -> None:
        """Nothing on standard error, which tests read."""


@pytest.fixture
def mirror(simulated: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Mirror]:
    """A server of the simulated log, which is a public one for once."""
    contents = simulated.read_bytes()
    log = PublicLog(NAME, "drive.log", hashlib.sha256(contents).hexdigest(), "a simulated building")
    monkeypatch.setitem(LOGS, NAME, log)
    monkeypatch.setenv("NO_PROXY", "*")
    with Mirror(contents) as server:
        thread = Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield server
        server.given_up.set()
        server.shutdown()
        thread.join()


def files(folder: str) -> list[str]:
    return [path.name for path in Path(folder).iterdir()]


def test_a_log_is_downloaded_once_and_can_be_indexed(call: Call, mirror: Mirror) -> None:
    arguments = ("fetch", NAME, "--folder", "logs", "--mirror", mirror.url("whole"))
    status, out, err = call(*arguments)
    path = Path(out.removesuffix("\n"))
    assert (status, err) == (0, "") and path.is_absolute() and path.name == "drive.log"
    assert path.read_bytes() == mirror.contents and stat.S_IMODE(path.stat().st_mode) == 0o644
    assert call(*arguments) == (0, out, "") and mirror.asked == ["/whole/drive.log"]
    assert files("logs") == ["drive.log"]
    status, out, _ = call("index", path, "--index", "i")
    assert status == 0 and "drive" in out


def test_what_is_there_needs_no_network(call: Call, mirror: Mirror) -> None:
    assert call("fetch", NAME, "--folder", "logs", "--mirror", mirror.url("whole"))[0] == 0
    assert call("fetch", NAME, "--folder", "logs", "--mirror", mirror.url("missing"))[0] == 0
    Path("logs/drive.log").write_bytes(b"damaged")
    assert call("fetch", NAME, "--folder", "logs", "--mirror", mirror.url("missing"))[0] == 2
    assert call("fetch", NAME, "--folder", "logs", "--mirror", mirror.url("whole"))[0] == 0
    assert Path("logs/drive.log").read_bytes() == mirror.contents


def test_folder_and_mirror_from_the_environment(
    call: Call, mirror: Mirror, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("M2T_CACHE", "cache")
    monkeypatch.setenv("M2T_MIRROR", mirror.url("whole") + "/")
    status, out, _ = call("fetch", NAME, "--json")
    (log,) = json.loads(out)["logs"]
    assert status == 0 and log["name"] == NAME and log["sha256"] == LOGS[NAME].sha256
    assert log["path"] == str(Path("cache/drive.log").absolute()) and Path(log["path"]).is_file()


def test_the_default_folder_is_the_users_cache(mirror: Mirror, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(public_logs, "cache_folder", lambda: Path("home/cache"))
    assert fetch(NAME, mirror=mirror.url("whole")) == Path("home/cache/drive.log").absolute()


def test_progress_ends_with_all_bytes(mirror: Mirror) -> None:
    told: list[tuple[int, int]] = []
    fetch(NAME, "logs", mirror.url("whole"), lambda done, of: told.append((done, of)))
    size = len(mirror.contents)
    assert told[0] == (public_logs.CHUNK, size) and told[-1] == (size, size) and told == sorted(told)
    told.clear()
    Path("logs/drive.log").unlink()
    fetch(NAME, "logs", mirror.url("endless"), lambda done, of: told.append((done, of)))
    assert set(told) == {(0, 0)}  # the server does not say how long it is


@pytest.mark.parametrize(
    ("folder", "message"),
    [
        ("missing", "404 Client Error: Not Found for url: http://127.0.0.1"),
        ("broken", "503 Server Error: Service Unavailable"),
        ("changed", f"what 127.0.0.1 sent for {NAME} has another sha256 and was not kept"),
        ("cut", "the download of here/drive from 127.0.0.1 failed"),
        ("silent", "no answer from 127.0.0.1 in 0.2 s; check the network, or name a mirror with --mirror"),
        ("stalled", "no connection to 127.0.0.1, or it was lost"),
    ],
)
def test_a_failed_download_is_one_line_and_leaves_nothing(
    call: Call, mirror: Mirror, monkeypatch: pytest.MonkeyPatch, folder: str, message: str
) -> None:
    monkeypatch.setattr(public_logs, "TIMEOUT", 0.2)
    status, out, err = call("fetch", NAME, "--folder", "logs", "--mirror", mirror.url(folder))
    assert (status, out) == (2, "") and message in err
    assert err.startswith("m2t-text: ") and err.count("\n") == 1
    assert mirror.asked and files("logs") == []


def test_no_network(call: Call) -> None:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    line = ("fetch", "radish/fr101", "--folder", "logs", "--mirror", f"http://127.0.0.1:{port}")
    status, out, err = call(*line)
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert "no connection to 127.0.0.1, or it was lost; check the network, or name a mirror" in err
    assert files("logs") == []


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")
def test_a_full_disk(call: Call, mirror: Mirror) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(mirror.contents) // 2, limits[1]))
    try:
        status, out, err = call("fetch", NAME, "--folder", "logs", "--mirror", mirror.url("whole"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (status, out) == (2, "") and err.count("\n") == 1
    assert err.startswith(f"m2t-text: cannot keep {NAME} in /") and err.endswith("/logs: File too large\n")
    assert files("logs") == []


def test_an_interrupted_download(mirror: Mirror) -> None:
    line = [*PROGRAM, "fetch", "radish/fr101", "--folder", "logs", "--mirror", mirror.url("stalled")]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert mirror.half_sent.wait(20)
    process.send_signal(signal.SIGINT)
    assert process.communicate() == ("", "m2t-text: interrupted; nothing was left half done\n")
    assert process.returncode == 130 and files("logs") == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["radish/fr97"], "no public log 'radish/fr97'; there are radish/aces, radish/csail, radish/fr079"),
        (["radish/fr101", "fr079"], "no public log 'fr079'"),
        (["radish/fr101", "--mirror", "ftp://example.org"], "'ftp://example.org' is no mirror"),
        (["radish/fr101", "--mirror", "http://"], "is no mirror; name the http or https address of a folder"),
        (["radish/fr101", "--mirror", "http://[x/"], "is no mirror"),
        (["radish/fr101", "--folder", "file"], "/file': File exists"),
    ],
)
def test_a_wrong_call_gets_one_line(call: Call, arguments: list[str], message: str) -> None:
    Path("file").write_text("")
    status, out, err = call("fetch", *arguments)
    assert (status, out) == (2, "") and message in err
    assert err.startswith("m2t-text: ") and err.count("\n") == 1


def test_without_a_name_all_are_listed(call: Call, mirror: Mirror) -> None:
    assert call("fetch", NAME, "--folder", "logs", "--mirror", mirror.url("whole"))[0] == 0
    status, out, err = call("fetch", "--folder", "logs")
    assert (status, err) == (0, "") and all(name in out for name in LOGS)
    logs = {
        log["name"]: log["path"] for log in json.loads(call("fetch", "--folder", "logs", "--json")[1])["logs"]
    }
    assert set(logs) == set(LOGS) and logs[NAME] == str(Path("logs/drive.log").absolute())
    assert not any(path for name, path in logs.items() if name != NAME)


def test_the_checksums_are_those_of_the_real_logs(radish: Path) -> None:
    for log in LOGS.values():
        assert hashlib.sha256((radish / log.file).read_bytes()).hexdigest() == log.sha256
