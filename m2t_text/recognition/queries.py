"""What a user names on the command line, found: a map of the index, a run of a log, or a text."""

import re
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from m2t_text.config import Parameters
from m2t_text.description.document import Document, map_id_of
from m2t_text.description.text import Text, parse
from m2t_text.errors import QueryError, TextError
from m2t_text.index.searchable import Searchable
from m2t_text.logs import Log
from m2t_text.recognition.earlier import Earlier, distances, earlier_maps, indexed_before
from m2t_text.sources.opening import SourceOptions, is_source, open_log, open_source
from m2t_text.util.files import is_file
from m2t_text.util.names import CLOUDS, is_saved_map

RUN = re.compile(r"(?P<log>.+)(?P<kind>[@#])(?P<number>[^@#/]*)", re.DOTALL)
MAP_ID = re.compile(r"(?P<dataset>.+)/(?P<number>[0-9]+)", re.DOTALL)
ROUNDING = 0.005  # m; travel is shown to two decimals, and what is shown must name the same map
MAX_TEXT_BYTES = 1 << 26  # bytes; the longest text read, some hundred thousand times a map's
KINDS = (
    "a map id DATASET/NUMBER, LOG@METRES, LOG#SCAN, DATASET@METRES, "
    "a .txt or point cloud file, or - for standard input"
)


@dataclass(frozen=True)
class Query:
    """A text to look up or to look at, and the map that it describes; None for a text alone.

    Attributes:
        warnings: one line for each kind of damage that was skipped in the file that the map comes from.
        cut: whether the map was cut out of a log, be it a single scan.
        earlier: maps of the same drive that lead to it, whose hits must agree with an answer.
    """

    text: Text
    document: Document | None = None
    warnings: tuple[str, ...] = ()
    cut: bool = False
    earlier: tuple[Earlier, ...] = ()

    @classmethod
    def of(cls, document: Document, warnings: tuple[str, ...] = ()) -> "Query":
        """To look up what a map shows."""
        return cls(document.text, document, warnings)

    @property
    def title(self) -> str:
        """The map's id, if there is a map."""
        return self.document.map_id if self.document else "text"

    @property
    def driven(self) -> bool:
        """Whether there is a map that has scans."""
        return self.document is not None and (self.cut or self.document.driven)

    def excluding(self, metres: float | None) -> tuple[str, float, float] | None:
        """What ``MapIndex.search`` leaves out: maps of the same dataset within these metres of travel.

        Raises:
            QueryError: if the query is a text alone, or a map without a drive.
        """
        if metres is None:
            return None
        if self.document is None or not self.driven:
            what = "a map without a drive" if self.document else "a text alone"
            raise QueryError(f"{what} has no travel to exclude; name the map by its id or by its log")
        return (self.document.dataset, self.document.middle, metres)


@dataclass(frozen=True)
class Context:
    """Where names are looked up, and how logs are described.

    Attributes:
        parameters: those of the index where there is one.
        index: None where there is none; logs and texts need none.
        options: how to read files, with the dataset's name of a log where it is not the file's.
        run: metres of travel in a map that is cut from a log, 0 for a single scan; None for what the
            parameters say.
        sequence: metres of the drive, up to the end of the query's run, whose earlier maps lead to it; None for
            the query alone.
    """

    parameters: Parameters
    index: Searchable | None = None
    options: SourceOptions = field(default_factory=SourceOptions)
    run: float | None = None
    sequence: float | None = None
    _logs: dict[str, Log] = field(default_factory=dict, compare=False, repr=False)

    def log(self, name: str) -> Log:
        """The log in a file, which is read once, however many queries are cut from it."""
        if name not in self._logs:
            self._logs.clear()  # one is enough for queries that follow each other, and logs are large
            self._logs[name] = open_log(Path(name), self.options)
        return self._logs[name]

    @property
    def described(self) -> Parameters:
        """How a map that is cut from a log is described: as the others, on a run of its own length."""
        if self.run is None:
            return self.parameters
        return replace(self.parameters, mapping=replace(self.parameters.mapping, run_length=self.run))


def resolve(target: str, context: Context) -> Query:
    """The query that a string names, with the maps that lead to it if the context asks for them.

    Raises:
        QueryError, SourceError: one line saying what there is instead, or what to try.
        TextError: naming the broken token.
    """
    query = _resolved(target, context)
    if context.sequence is None or query.earlier:
        return query
    if query.document is None or not query.driven:
        raise QueryError(f"{target!r} is no map of a drive, which a sequence takes: name one by its id or log")
    if context.index is None or not len(context.index.runs(query.document.dataset)[0]):
        return query
    return replace(query, earlier=indexed_before(context.index, query.document, context.sequence))


def _resolved(target: str, context: Context) -> Query:
    """The query by itself.

    Raises:
        QueryError, SourceError: one line saying what there is instead, or what to try.
        TextError: naming the broken token.
    """
    run = RUN.fullmatch(target)
    if context.run is not None and run is None:
        raise QueryError(f"--run cuts a run out of a log; {target!r} is none, as LOG@METRES or LOG#SCAN is")
    if target == "-":
        return Query(_parsed(_standard_input(), "standard input"))
    document = context.index.find_document(target) if context.index is not None else None
    if document is not None:
        return Query.of(document)
    if run and is_source(Path(run["log"])):
        return _run_of_log(run, context)
    if run and _number(run) is not None:
        return _map_of_dataset(run, context) or _run_of_log(run, context)
    if target.lower().endswith(".txt"):
        return Query(_parsed(_contents(Path(target)), repr(target)))
    if Path(target).suffix.lower() in CLOUDS:
        source = open_source(target, context.options)
        (document,) = source.describe(context.parameters, 1, lambda stage, done, of: None).documents
        return Query.of(document, source.warnings)
    raise QueryError(_unknown(target, context))


def _run_of_log(run: re.Match[str], context: Context) -> Query:
    from m2t_text.pipeline import describe_at  # compiled code, slow to import, and only logs need it

    number = _number(run)
    if number is None:
        kind = "the number of a scan, as #40" if run["kind"] == "#" else "metres of travel, as @12.5"
        raise QueryError(f"{run[0]!r} does not end in {kind}")
    log = context.log(run["log"])
    scan = int(number) if run["kind"] == "#" else _scan_after(number, log, context)
    if scan >= len(log.scans):
        raise QueryError(f"{run[0]!r}: the log has {len(log.scans)} scans, #0 to #{len(log.scans) - 1}")
    document = describe_at(log, scan, context.described)
    way, needed = float(np.ptp(document.travel)), context.described.mapping.run_length
    if context.index is not None and document.first_scan in _indexed(log, context.index)[0]:
        # The travel and pose that others are compared with; a run by itself has those of the wheel odometry.
        stored = context.index.document(document.map_id)
        travelled = stored.travel if context.run is None else stored.travel[0] + np.array([0.0, way])
        document = replace(document, travel=travelled, pose=stored.pose)
        return Query(document.text, document, log.warnings, cut=True)
    if document.last_scan + 1 in (*log.cuts, len(log.scans)) and way < needed:
        ends = "the log ends" if document.last_scan + 1 == len(log.scans) else "the drive is cut"
        raise QueryError(
            f"{run[0]!r}: a map takes {needed:g} m of travel, and {ends} {way:.2f} m after scan #{scan}; name "
            "an earlier one"
        )
    return Query(document.text, document, log.warnings, cut=True, earlier=_before(log, scan, context))


def _before(log: Log, scan: int, context: Context) -> tuple[Earlier, ...]:
    """The maps of a log that is not in the index that lead to the one that begins at a scan."""
    if context.sequence is None:
        return ()
    from m2t_text.pipeline import describe_before

    behind = distances(context.sequence, context.described.mapping.run_length)
    return earlier_maps(*describe_before(log, scan, behind, context.described))


def _map_of_dataset(run: re.Match[str], context: Context) -> Query | None:
    """The map of an indexed dataset that begins at a scan or after some metres; None without such a dataset."""
    index, number = context.index, _number(run)
    if index is None or number is None:
        return None
    scans, begins = index.runs(run["log"])
    if not len(scans):
        return None
    if context.run is not None:
        raise QueryError(
            f"--run cuts a run out of a log; {run['log']!r} is a dataset of the index, name its log"
        )
    by_scan = run["kind"] == "#"
    place = int(np.searchsorted(scans if by_scan else begins, number if by_scan else number - ROUNDING))
    if place == len(scans):
        raise QueryError(
            f"{run[0]!r}: the last map of {run['log']} begins after {begins[-1]:.2f} m, at scan #{scans[-1]}"
        )
    return Query.of(index.document(map_id_of(run["log"], int(scans[place]))))


def _indexed(log: Log, index: Searchable) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The first scans of a log's maps, and the travel at which they begin; both are empty if it is not indexed.

    A dataset of its name without a drive, as a saved map, is another."""
    scans, begins = index.runs(log.name)
    if len(scans) and index.document(map_id_of(log.name, int(scans[0]))).driven:
        return scans, begins
    return scans[:0], begins[:0]


def _number(run: re.Match[str]) -> float | None:
    """Metres or a scan; None if it is no such number."""
    pattern = r"[0-9]+" if run["kind"] == "#" else r"[0-9]+\.?[0-9]*|\.[0-9]+"
    return float(run["number"]) if re.fullmatch(pattern, run["number"]) else None


def _scan_after(metres: float, log: Log, context: Context) -> int:
    """The scan at which a map begins after so much travel: as the index has it, else by the wheel odometry."""
    scans, begins = _indexed(log, context.index) if context.index else (np.zeros(0, np.int64), np.zeros(0))
    if len(scans):
        place = int(np.searchsorted(begins, metres - ROUNDING))
        if place < len(scans):
            return int(scans[place])
        begin, scan = float(begins[-1]), int(scans[-1])
    else:
        from m2t_text.mapping.trajectory import travel_of  # compiled code, slow to import

        way = travel_of(log)
        place = int(np.searchsorted(way, metres - ROUNDING))
        if place < len(way):
            return place
        begin = max(0.0, float(way[-1]) - context.described.mapping.run_length)
        scan = int(np.searchsorted(way, begin, side="right")) - 1
    raise QueryError(f"{log.name}@{metres:g}: the log's last map begins after {begin:.2f} m, at scan #{scan}")


def _standard_input() -> bytes:
    try:
        return sys.stdin.buffer.read(MAX_TEXT_BYTES + 1)
    except (AttributeError, OSError) as error:  # it is None or closed where a process is started without one
        raise QueryError("standard input cannot be read; pipe a text into it, or name a .txt file") from error


def _contents(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(MAX_TEXT_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise QueryError(f"cannot read the text {str(path)!r}: {reason}") from error


def _parsed(contents: bytes, where: str) -> Text:
    if len(contents) > MAX_TEXT_BYTES:
        raise QueryError(f"{where} is longer than {MAX_TEXT_BYTES >> 20} MB: not the text of a map")
    try:
        text = parse(contents.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise QueryError(f"{where} is not a text: byte {error.start} is no UTF-8") from error
    except TextError as error:
        raise TextError(f"{where}: {error}") from error
    if not len(text):
        raise QueryError(f"{where} holds no token; `m2t-text inspect` prints the text of a map")
    return text


def _unknown(target: str, context: Context) -> str:
    """Why a string names nothing, and what to try."""
    if is_saved_map(Path(target)) and is_file(Path(target)):
        return f"{target!r} is a whole map; index it, and name one of its local maps, or look up a log in it"
    if is_source(Path(target)):
        return f"{target!r} is a whole log; name a run of it, as {target}@12.5 (metres) or {target}#40 (scan)"
    named = MAP_ID.fullmatch(target)
    if named is None:
        return f"{target!r} is neither a map nor a file; name {KINDS}"
    if context.index is None:
        return f"there is no index to find the map {target!r} in; make one with `m2t-text index LOG`"
    dataset, number = named["dataset"], int(named["number"])
    scans, _ = context.index.runs(dataset)
    if len(scans):
        nearest = map_id_of(dataset, int(scans[np.abs(scans - number).argmin()]))
        return f"no map {target!r} in {context.index.path}; the nearest of its {len(scans)} maps is {nearest}"
    return context.index.lacking(dataset)
