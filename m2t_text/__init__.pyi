# What the package offers under its own name; `__init__.py` loads each from here when it is first used.

from .cluster.cluster_index import ClusterIndex
from .config import PROFILES, Parameters
from .description.document import Document
from .description.text import Text, parse
from .errors import (
    ClusterError,
    FetchError,
    LogError,
    M2TError,
    MapIndexError,
    QueryError,
    SourceError,
    TextError,
)
from .index.map_index import MapIndex, open_index
from .index.merging import indexes_in, merge
from .index.results import DatasetSummary, Hit, IndexInfo
from .live.localizer import Localizer
from .live.odometry import OdometryBuffer
from .live.place import Place
from .live.survey import LiveSurvey
from .logs import read_log
from .logs.log import Log, LogOptions, Scan
from .logs.simulation.simulator import Simulation, simulate, write_carmen
from .loops.growing import GrowingDataset
from .loops.online import OnlineLoops
from .pipeline import describe, describe_at, describe_log
from .recognition.answer import Answer, SearchOptions, search
from .recognition.finding import Finding, find, find_many, verify_hits
from .recognition.found import Found
from .recognition.queries import Query
from .recognition.verification import Alignment, align, relative_pose
from .slam.mapping import MapOfLogs, map_logs
from .sources.opening import LogSource, SourceOptions, open_source
from .sources.public_logs import LOGS, fetch
from .sources.saved_map import SavedMap

__version__: str
__all__ = [
    "LOGS",
    "PROFILES",
    "Alignment",
    "Answer",
    "ClusterError",
    "ClusterIndex",
    "DatasetSummary",
    "Document",
    "FetchError",
    "Finding",
    "Found",
    "GrowingDataset",
    "Hit",
    "IndexInfo",
    "LiveSurvey",
    "Localizer",
    "Log",
    "LogError",
    "LogOptions",
    "LogSource",
    "M2TError",
    "MapIndex",
    "MapIndexError",
    "MapOfLogs",
    "OdometryBuffer",
    "OnlineLoops",
    "Parameters",
    "Place",
    "Query",
    "QueryError",
    "SavedMap",
    "Scan",
    "SearchOptions",
    "Simulation",
    "SourceError",
    "SourceOptions",
    "Text",
    "TextError",
    "align",
    "describe",
    "describe_at",
    "describe_log",
    "fetch",
    "find",
    "find_many",
    "indexes_in",
    "map_logs",
    "merge",
    "open_index",
    "open_source",
    "parse",
    "read_log",
    "relative_pose",
    "search",
    "simulate",
    "verify_hits",
    "write_carmen",
]
