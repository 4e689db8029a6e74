"""What can be typed to choose maps: Whoosh's query language, and ``TOKEN~`` for a token and its neighbours."""

import re
from typing import Any

from whoosh.fields import Schema
from whoosh.qparser import QueryParser
from whoosh.qparser.common import QueryParserError
from whoosh.query import Every, NullQuery, Phrase, Query, Term

from m2t_text.config import LIMITS
from m2t_text.description.text import parse
from m2t_text.errors import QueryError, TextError

SHOWN = 80  # characters of a broken query
DEEPEST = 12  # operators within operators: each ANDNOT, ANDMAYBE or REQUIRE doubles the time that Whoosh takes
NEAR = re.compile(r"(.*)~(\d{0,9})", re.ASCII)


def parse_query(string: str, schema: Schema) -> Query:
    """The Whoosh query of a string; what names no field is looked up in the maps' texts.

    A token finds the maps that have it; ``x12_y-3_a5~`` those that have it within the window of the index, and
    ``x12_y-3_a5~3`` within 3 cells, in the maps' own frames.

    Raises:
        QueryError: saying what is wrong with it.
    """
    shown = string if len(string) <= SHOWN else string[: SHOWN - 3] + "..."
    parser = QueryParser("text", schema)
    try:
        string.encode()  # Whoosh looks names up as UTF-8
        deep = _depth(parser.process(string)) > DEEPEST
        query = NullQuery if deep else parser.parse(string).accept(_with_neighbours)
    except (QueryParserError, TextError, UnicodeEncodeError) as error:
        raise QueryError(f"{shown!r} is not a query: {error}") from error
    except (AssertionError, IndexError) as error:  # in Whoosh, of operators as NOT NOT or ANDNOT ANDNOT
        raise QueryError(f"{shown!r} is not a query: an operator has nothing to work on") from error
    except RecursionError:
        deep, query = True, NullQuery
    if deep:
        raise QueryError(f"{shown!r} nests operators too deeply; {DEEPEST} levels at most")
    broken = [leaf.error for leaf in query.leaves() if leaf.error is not None]
    if broken or query is NullQuery:
        raise QueryError(f"{shown!r} is not a query: {broken[0] if broken else 'it is empty'}")
    return query


def _with_neighbours(query: Query) -> Query:
    """The query itself; for ``TOKEN~`` one that finds the token's neighbours, too; for all tokens a quick one.

    Raises:
        TextError: if it looks for what no text can hold.
    """
    if isinstance(query, Phrase) and query.fieldname == "text":
        raise TextError("tokens have no order; leave out the quotes, and join them with AND")
    if isinstance(query, Every) and query.fieldname == "text":
        from m2t_text.index.search.query import AnyToken  # compiled code, slow to import

        return AnyToken(query.fieldname, query.boost)
    if not isinstance(query, Term) or query.fieldname != "text":
        return query
    match = NEAR.fullmatch(query.text)
    text = parse(query.text if match is None else match[1])
    if match is None:
        return query
    if not len(text):  # a free square is looked for as it is
        return Term(query.fieldname, match[1], query.boost)
    from m2t_text.index.search.query import MapQuery  # compiled code, slow to import

    if match[2] and int(match[2]) > LIMITS["window"][1]:
        raise TextError(f"{query.text!r} asks for a window of more than {LIMITS['window'][1]} cells")
    window = int(match[2]) if match[2] else None
    return MapQuery(text, query.fieldname, turns=(0,), window=window, boost=query.boost)


def _depth(group: Any) -> int:
    """How many of Whoosh's groups of syntax lie within each other; level by level, as recursion has an end."""
    depth, level = 0, [group]
    while level:
        depth, level = depth + 1, [node for one in level for node in getattr(one, "nodes", ())]
    return depth
