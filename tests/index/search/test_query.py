"""The map query among Whoosh's own: filters, masks, joins, and the query parser."""

import pytest
from map_oracle import document, random_documents, text_of
from whoosh.matching import NullMatcher, ReadTooFar
from whoosh.query import (
    And,
    AndMaybe,
    AndNot,
    ConstantScoreQuery,
    Every,
    Not,
    NullQuery,
    Or,
    Prefix,
    Require,
    Term,
    Wildcard,
)
from whoosh.scoring import BM25F

from m2t_text.config import MatchingParameters, Parameters
from m2t_text.errors import QueryError
from m2t_text.index.map_index import MapIndex
from m2t_text.index.search.query import MapQuery, NumberRange
from m2t_text.index.search.weighting import HistogramIntersection

PLAIN = Parameters(matching=MatchingParameters(weighted=False))


@pytest.fixture(scope="module")
def corridor(tmp_path_factory):
    """Five maps, in two segments, one of them deleted; 'x0_y0_a5' matches b/1, b/2 and 'the log'/3."""
    index = MapIndex.create(tmp_path_factory.mktemp("corridor"), PLAIN)
    a = [
        document("a", 0, text_of("x0_y0_a1 x5_y5_a2"), travel=10.0),
        document("a", 9, text_of("x0_y0_a5"), travel=50.0),
    ]
    b = [
        document("b", 1, text_of("x10_y-10_a5 x0_y0_a1"), travel=20.0),
        document("b", 2, text_of("x-3_y4_a5 x3_y4_a5"), travel=30.0),
        document("b", 7, text_of("x11_y0_a5 x0_y-11_a5"), travel=40.0),
    ]
    c = [document("the log", 3, text_of("x1_y0_a5"), travel=20.5)]
    for name, documents in (("b", b), ("a", a), ("the log", c)):
        index.replace(name, documents)
    whoosh = index.whoosh.writer()
    whoosh.delete_by_term("map_id", "a/000009")
    whoosh.commit(merge=False)
    return index


def ids(index: MapIndex, query, **options) -> dict[str, float]:
    with index.searcher() as searcher:
        return {hit["map_id"]: hit.score for hit in searcher.search(query, limit=None, **options)}


FIVE = MapQuery(text_of("x0_y0_a5"), turns=(0,))
EXPECTED = {"b/000001": 1.0, "b/000002": 1.0, "the log/000003": 1.0}


def test_a_token_is_found_within_the_window_and_not_beyond(corridor):
    assert ids(corridor, FIVE) == EXPECTED
    assert ids(corridor, MapQuery(text_of("x-14_y-6_a5"), turns=(0,))) == {}
    assert set(ids(corridor, MapQuery(text_of("x-13_y-6_a5"), turns=(0,)))) == {"b/000002"}


def test_filter_and_mask(corridor):
    assert set(ids(corridor, FIVE, filter=Term("dataset", "b"))) == {"b/000001", "b/000002"}
    assert set(ids(corridor, FIVE, mask=Term("dataset", "b"))) == {"the log/000003"}
    assert set(ids(corridor, FIVE, filter=NumberRange("travel", 15, 25))) == {"b/000001", "the log/000003"}
    assert set(ids(corridor, Every(), filter=FIVE)) == set(EXPECTED)
    assert set(ids(corridor, Every(), mask=FIVE)) == {"a/000000", "b/000007"}


def test_joined_with_other_queries(corridor):
    one = MapQuery(text_of("x0_y0_a1"), turns=(0,))
    b = Term("dataset", "b")
    assert ids(corridor, And([FIVE, b])) == {"b/000001": 1.0, "b/000002": 1.0}
    assert ids(corridor, And([FIVE, Not(b)])).keys() == {"the log/000003"}  # Whoosh's Not adds 1
    assert ids(corridor, AndNot(FIVE, b)) == {"the log/000003": 1.0}
    assert ids(corridor, Require(FIVE, b)) == {"b/000001": 1.0, "b/000002": 1.0}
    assert ids(corridor, And([FIVE, one])) == {"b/000001": 2.0}
    assert ids(corridor, Or([FIVE, one])) == EXPECTED | {"b/000001": 2.0, "a/000000": 1.0}
    assert ids(corridor, AndMaybe(FIVE, one)) == EXPECTED | {"b/000001": 2.0}
    assert ids(corridor, Not(FIVE)).keys() == {"a/000000", "b/000007"}
    assert ids(corridor, ConstantScoreQuery(FIVE, 7.0)).keys() == EXPECTED.keys()
    assert ids(corridor, FIVE.with_boost(3.0)) == dict.fromkeys(EXPECTED, 3.0)
    assert ids(corridor, Or([FIVE, b])).keys() == EXPECTED.keys() | {"b/000007"}
    assert ids(corridor, (FIVE | one) & NumberRange("travel", None, 20)) == {"a/000000": 1.0, "b/000001": 2.0}


def test_other_weightings_leave_the_score_to_the_parameters_of_the_index(corridor):
    with corridor.whoosh.searcher(weighting=BM25F()) as searcher:
        assert {hit["map_id"]: hit.score for hit in searcher.search(FIVE)} == EXPECTED
        assert len(searcher.search(And([FIVE, Term("dataset", "b")]))) == 2
    with corridor.whoosh.searcher(weighting=HistogramIntersection(window=11, weighted=False)) as searcher:
        assert {hit["map_id"]: hit.score for hit in searcher.search(FIVE)} == EXPECTED | {"b/000007": 1.0}
        assert "b/000007" in [hit["map_id"] for hit in searcher.search(Every(), filter=FIVE)]
    with corridor.searcher("bow") as searcher:
        assert {hit["map_id"]: hit.score for hit in searcher.search(FIVE)} == EXPECTED | {"b/000007": 1.0}


def test_sorting_grouping_and_limits(corridor):
    with corridor.searcher() as searcher:
        assert [hit["map_id"] for hit in searcher.search(FIVE, sortedby="travel", reverse=True)] == [
            "b/000002", "the log/000003", "b/000001",
        ]  # fmt: skip
        assert {k: len(v) for k, v in searcher.search(FIVE, groupedby="dataset").groups().items()} == {
            "b": 2,
            "the log": 1,
        }
        assert len(searcher.search(FIVE, limit=1)) == 3
        assert searcher.search(FIVE, limit=1).scored_length() == 1


@pytest.mark.parametrize(
    "string, found",
    [
        ("x0_y0_a5~", set(EXPECTED)),
        ("text:x0_y0_a5~", set(EXPECTED)),
        ("x0_y0_a5~ AND dataset:b", {"b/000001", "b/000002"}),
        ("x0_y0_a5~ dataset:'the log'", {"the log/000003"}),
        ('x0_y0_a5~ dataset:"the log"', {"the log/000003"}),
        ("x0_y0_a5~ AND NOT dataset:b", {"the log/000003"}),
        ("x0_y0_a5~ AND travel:[20 TO 30]", set(EXPECTED)),
        ("x0_y0_a5~ AND travel:[20 to 20.5}", {"b/000001"}),
        ("x0_y0_a5~ AND travel:{20 to 30}", {"the log/000003"}),
        ("x0_y0_a5~ OR x0_y0_a1", set(EXPECTED) | {"a/000000"}),
        ("x3_y4_a5", {"b/000002"}),
        ("x3_y4_a5 AND NOT dataset:b", set()),
        ("x3_y3_a5~1", {"b/000002"}),
        ("x3_y3_a5~0", set()),
        ("x0_y0_f4~ OR x3_y3_f4", set()),
        ("x11_y0_a5~11^2 AND dataset:b", {"b/000001", "b/000002", "b/000007"}),
        ("x0_y*_a5", {"b/000007"}),
        ("x-3*", {"b/000002"}),
        ("[x1 TO x2]", {"b/000001", "b/000007", "the log/000003"}),
        ("text:*", {"a/000000", "b/000001", "b/000002", "b/000007", "the log/000003"}),
        ("travel:[35 to]", {"b/000007"}),
        ("travel:20.5", {"the log/000003"}),
        ("first_scan:[2 to 3]", {"b/000002", "the log/000003"}),
        ("map_id:b/000007", {"b/000007"}),
        ("NOT x0_y0_a5~", {"a/000000", "b/000007"}),
    ],
)
def test_the_query_parser(corridor, string, found):
    query = corridor.parse(string)
    assert set(ids(corridor, query)) == found
    assert {hit.map_id for hit in corridor.search(text_of(""), top=0, filter=string)} == found


@pytest.mark.parametrize("name", ["freiburg-101-corrected", "a.b_c", "2011-01-20-07-18-45", "Ünï", "to", "AND"])
def test_datasets_of_any_name_can_be_typed(tmp_path, name):
    index = MapIndex.create(tmp_path, PLAIN)
    index.replace("freiburg-101", random_documents(0, "freiburg-101", 2))
    index.replace(name, random_documents(1, name, 3))
    quoted = f"'{name}'" if name in ("to", "AND") else name
    assert len(ids(index, index.parse(f"dataset:{quoted}"))) == 3


@pytest.mark.parametrize(
    "string",
    [
        "",
        "(",
        "corridor",
        "text:corridor~",
        "x1_y1_a1~x",
        "x1_y1_a1~201",
        "x1_y1_a1024",
        '"x1_y1_a1 x2_y2_a2"',
        "travel:far",
        "travel:[a to b]",
        "record:x",
    ],
)
def test_what_cannot_be_looked_up_is_said(corridor, string):
    with pytest.raises(QueryError):
        corridor.parse(string)


def test_queries_are_values():
    again = MapQuery(text_of("x0_y0_a5"), turns=(0,))
    assert again == FIVE and hash(again) == hash(FIVE) and again != FIVE.with_boost(2.0)
    assert MapQuery(text_of("x0_y0_a5")) != FIVE and NullQuery != FIVE
    assert And([FIVE, again]).normalize() == FIVE
    assert NumberRange("travel", 1, 2) == NumberRange("travel", 1, 2) != NumberRange("travel", 1, 3)
    assert {NumberRange("travel", 1, 2), NumberRange("travel", 1, 2)} == {NumberRange("travel", 1, 2)}
    assert str(FIVE) == "text:x0_y0_a5" and str(NumberRange("travel", 1, None, True)) == "travel:{1 TO ]"
    assert "x0_y0_a5" in repr(FIVE) and "travel" in repr(NumberRange("travel", 1, 2))


def test_the_matcher_keeps_whooshs_protocol(corridor):
    with corridor.searcher() as searcher:
        leaf = searcher.leaf_searchers()[0][0]
        matcher = FIVE.matcher(leaf, searcher.context())
        assert matcher.all_ids() == [0, 1] and matcher.id() == 0 and matcher.score() == matcher.weight() == 1.0
        other = matcher.copy()
        assert matcher.next() is True and (matcher.id(), other.id()) == (1, 0)
        other.skip_to(1)
        assert other.id() == 1 and other.skip_to_quality(5.0) == 0
        other.skip_to(9)
        assert not other.is_active() and other.replace() is NullMatcher() and other.all_ids() == []
        for step in (other.next, lambda: other.skip_to(1)):
            with pytest.raises(ReadTooFar):
                step()
        other.reset()
        assert other.id() == 0 and other.max_quality() >= 1.0 and not other.supports("positions")


def test_an_empty_index_and_an_empty_text(tmp_path):
    index = MapIndex.create(tmp_path, PLAIN)
    assert ids(index, FIVE) == {} and ids(index, NumberRange("travel", 0, 9)) == {}
    assert index.search(text_of("x0_y0_a5"), top=0) == [] and index.ids == [] and index.datasets() == []
    index.replace("a", [document("a", 0, text_of("")), document("a", 1, text_of("x0_y0_a5"))])
    assert ids(index, MapQuery(text_of(""))) == {}
    assert ids(index, FIVE).keys() == {"a/000001"}


def test_terms_are_the_names_of_the_maps(corridor):
    with corridor.searcher() as searcher:
        reader = searcher.reader()
        assert [text.decode() for text in reader.lexicon("dataset")] == ["a", "b", "the log"]
        assert reader.doc_frequency("dataset", "b") == 3 and reader.doc_frequency("dataset", "c") == 0
        assert reader.term_info("map_id", "b/000002").doc_frequency() == 1
        assert [text.decode() for text in reader.expand_prefix("map_id", "b/00000")] == [
            "b/000001", "b/000002", "b/000007",
        ]  # fmt: skip
    assert set(ids(corridor, Prefix("map_id", "the"))) == {"the log/000003"}
    assert set(ids(corridor, Wildcard("dataset", "?"))) == {"a/000000", "b/000001", "b/000002", "b/000007"}
