"""Public laser logs by name: downloaded once, checked by their sha256, and kept in a cache folder."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from m2t_text.errors import FetchError
from m2t_text.util.files import make_folder

# Logs of the Radish repository (Howard and Roy, 2003), corrected with GMapping, as redistributed there.
SOURCE = (
    "https://raw.githubusercontent.com/acschaefer/ple/cfcb5a7f12a793b616357381a688cfcc26eed347/data/carmen/"
)
TIMEOUT = 30.0  # s without a byte
CHUNK = 1 << 16  # bytes between two steps of a progress bar


@dataclass(frozen=True)
class PublicLog:
    """A log that can be fetched.

    Attributes:
        name: what `fetch` calls it.
        file: its name at the source and in the cache folder, which also names the dataset.
        sha256: of the file.
        place: where it was recorded.
    """

    name: str
    file: str
    sha256: str
    place: str


LOGS = {
    log.name: log
    for log in (
        PublicLog(
            "radish/aces",
            "aces-corrected.log.gz",
            "5434d44384166250608a64d3a8c32de84512f82c46cb60a2657f138592024569",
            "UT Austin, ACES building",
        ),
        PublicLog(
            "radish/csail",
            "csail-corrected.log.gz",
            "a98de24fc319651f231f9a8625b78bf1972312b86f7b00d2ddc979c4ac92ae2d",
            "MIT, CSAIL",
        ),
        PublicLog(
            "radish/fr079",
            "freiburg-079-corrected.log.gz",
            "0631d30baf4b9d1d209af47da9096e876e1b4cb3d5a2d68ef9c39c5a2360a466",
            "Freiburg, building 079 (the paper's fr079)",
        ),
        PublicLog(
            "radish/fr101",
            "freiburg-101-corrected.log.gz",
            "7792de88bcb050f8edba92914aea75e8ec2fb73b483c01903bd2753aa655e982",
            "Freiburg, building 101 (the paper's fr101)",
        ),
        PublicLog(
            "radish/intel",
            "intel-corrected.log.gz",
            "71bef16e9926506cf7417995ef35ace09dbd5de067fd042a3aab85188b5480dc",
            "Intel Research Lab, Seattle",
        ),
    )
}


def public_log(name: str) -> PublicLog:
    """The log of this name. Raises FetchError, listing the known ones, if there is none."""
    if name not in LOGS:
        raise FetchError(f"no public log {name!r}; there are {', '.join(LOGS)}")
    return LOGS[name]


def cache_folder() -> Path:
    """Where logs are kept if nothing else is said: the user's cache, as the operating system has it."""
    import pooch

    return Path(pooch.os_cache("m2t-text"))


def fetch(
    name: str,
    folder: str | Path | None = None,
    mirror: str = SOURCE,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """The file of a public log; it is downloaded unless it is in the folder already, whole.

    Args:
        name: one of `LOGS`.
        folder: to keep it in, `cache_folder()` if None.
        mirror: URL of a folder that holds the file under the same name.
        progress: is called with the bytes received so far and all bytes (0 where the server does not say).

    Raises:
        FetchError: if there is no such log, it cannot be downloaded or kept, or its sha256 is another one.
            Nothing is left of a download that fails.

    Examples:
        >>> import m2t_text as m2t
        >>> sorted(m2t.LOGS)
        ['radish/aces', 'radish/csail', 'radish/fr079', 'radish/fr101', 'radish/intel']
        >>> log = m2t.read_log(m2t.fetch("radish/fr101"))  # doctest: +SKIP
    """
    log = public_log(name)
    host = _host(mirror)
    place = Path(folder) if folder is not None else cache_folder()
    make_folder(place)
    return _downloaded(log, place, mirror, host, _Meter(progress))


def _host(mirror: str) -> str:
    """The host of a mirror's address, which is shown while it is waited for."""
    with suppress(ValueError):  # brackets that hold no address
        address = urlsplit(mirror)
        if address.scheme in ("http", "https") and address.hostname:
            return address.hostname
    raise FetchError(f"{mirror!r} is no mirror; name the http or https address of a folder")


def _downloaded(log: PublicLog, folder: Path, mirror: str, host: str, meter: "_Meter") -> Path:
    import pooch
    import requests

    store = pooch.create(path=folder, base_url=mirror, registry={log.file: f"sha256:{log.sha256}"})
    downloader = pooch.HTTPDownloader(meter, CHUNK, timeout=TIMEOUT)
    again = "check the network, or name a mirror with --mirror"
    try:
        return Path(store.fetch(log.file, _readable, downloader))
    except requests.HTTPError as error:
        raise FetchError(f"{error}; name another with --mirror") from error
    except requests.Timeout as error:
        raise FetchError(f"no answer from {host} in {TIMEOUT:g} s; {again}") from error
    except requests.ConnectionError as error:
        raise FetchError(f"no connection to {host}, or it was lost; {again}") from error
    except requests.RequestException as error:  # it ended too soon, for one
        raise FetchError(f"the download of {log.name} from {host} failed; {again}") from error
    except OSError as error:
        raise FetchError(f"cannot keep {log.name} in {folder}: {error.strerror or error}") from error
    except ValueError as error:
        raise FetchError(
            f"what {host} sent for {log.name} has another sha256 and was not kept; name another with --mirror"
        ) from error


def _readable(path: str, action: str, store: object) -> str:
    """Lets others read a downloaded file, which is made for its owner alone."""
    if action != "fetch":
        Path(path).chmod(0o644)
    return path


class _Meter:
    """What pooch takes for a progress bar."""

    def __init__(self, progress: Callable[[int, int], None] | None) -> None:
        self._progress = progress
        self._done = 0
        self.total = 0  # set by pooch

    def update(self, size: int) -> None:
        """Pooch counts whole chunks, and at the end all of them once more."""
        self._done = min(self._done + size, self.total)
        if self._progress is not None:
            self._progress(self._done, self.total)

    def reset(self) -> None:
        self._done = 0

    def close(self) -> None:
        """Nothing is held that could be closed."""
