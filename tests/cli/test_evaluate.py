"""Whole evaluations of a small simulated log, from the command line and as objects."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from m2t_text.cli import run
from m2t_text.evaluation.judging import Judgement
from m2t_text.evaluation.report import mean, methods, published, report
from m2t_text.evaluation.run import Evaluation, EvaluationRequest, evaluate
from m2t_text.logs import read_log
from m2t_text.logs.simulation.simulator import Simulation, simulate, write_carmen
from m2t_text.util.geometry import travel

Call = Callable[..., tuple[int, str, str]]
RECALLS = {"1", "3"}


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log that comes back to places, called as one of the paper's."""
    path = tmp_path_factory.mktemp("loop") / "fr079-simulated.log"
    write_carmen(simulate(Simulation(seed=12, length=24.0, travel=42.0, step=0.5, beams=90)), path)
    return path


@pytest.fixture(scope="module")
def unusable(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Logs that cannot be evaluated, by name."""
    folder = tmp_path_factory.mktemp("unusable")
    once = simulate(Simulation(seed=5, length=24.0, travel=12.0))
    logs = {
        "once.log": once,
        "blind.log": replace(once, ground_truth=None),
        "short.log": simulate(Simulation(seed=5, length=24.0, travel=2.0, step=0.05)),
    }
    for name, log in logs.items():
        write_carmen(log, folder / name)
    return {name: folder / name for name in logs}


@pytest.fixture(scope="module")
def evaluation(loop: Path) -> Evaluation:
    return evaluate(EvaluationRequest([loop], queries=16))


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Runs one command line in an empty folder: (exit status, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> tuple[int, str, str]:
        status = run([str(argument) for argument in arguments])
        return status, *capsys.readouterr()

    return call


def test_json_and_pictures(call: Call, loop: Path) -> None:
    status, out, err = call("evaluate", loop, "--queries", 6, "--json", "--plot", "new/pictures")
    drawn = ["anr.png", "fr079-simulated-map.png", "fr079-simulated-pairs.png"]
    assert status == 0 and sorted(path.name for path in Path("new/pictures").iterdir()) == drawn
    assert err.count("\n") == len(drawn) and all(name in err for name in drawn)
    assert all(Path("new/pictures", name).stat().st_size > 10_000 for name in drawn)
    document = json.loads(out)
    assert document["profile"] == "default" and document["parameters"]["mapping"]["run_length"] > 0
    (dataset,) = document["datasets"]
    log = read_log(loop)
    assert dataset["dataset"] == "fr079-simulated" and dataset["scans"] == len(log.scans)
    assert dataset["travel"] == pytest.approx(travel(log.ground_truth)[-1], rel=0.1)
    assert dataset["queries"] == 6 <= dataset["pairs"] and 12 < dataset["maps"] < dataset["scans"]
    assert dataset["published_anr"] == {"bow": 24.0, "m2t": 17.1}
    for figures in (dataset["methods"], document["mean"]):
        assert set(figures) == {"bow", "m2t", "verified"}
        assert all(set(figures[method]["recall_at_1"]) == RECALLS for method in figures)
        verified = figures["verified"]
        silent = [verified[f"{kind}_precision"] is None for kind in ("verdict", "match")]  # no match at all
        assert sum(number is None for number in numbers(figures)) == sum(silent)
        shares = [figures[method]["anr"] for method in ("bow", "m2t")]
        shares += [share for method in figures for share in figures[method]["recall_at_1"].values()]
        shares += [figures["verified"][f"verdict_{name}"] or 0.0 for name in ("precision", "recall")]
        shares += [verified[name] or 0.0 for name in ("pose_recall", "match_precision", "match_recall")]
        assert all(0 <= share <= 100 for share in shares)
        assert 0 <= figures["verified"]["translation_error_median"] < 4
        assert 0 <= figures["verified"]["rotation_error_median"] <= math.pi
        assert 0 <= verified["unvisited_matches"] <= verified["unvisited"] <= 6
        assert verified["elsewhere"] == verified["elsewhere_matches"] == 0  # there is no other log
    assert document["mean"] == dataset["methods"]


def test_several_logs_are_looked_up_in_each_other(loop: Path, tmp_path: Path) -> None:
    """Another drive through the same building is the other log here, so that places are found in it."""
    part = tmp_path / "part.log"
    write_carmen(simulate(Simulation(seed=12, length=24.0, travel=42.0, step=0.5, beams=90, drive=1)), part)
    found = evaluate(EvaluationRequest([loop, part], queries=4))
    for dataset in found.datasets:
        asked, matched = dataset.elsewhere
        assert asked == 4 and matched > 1
    assert report(found)["mean"]["verified"]["elsewhere"] == 4


def numbers(figures: Any) -> list[Any]:
    if isinstance(figures, dict):
        return [number for figure in figures.values() for number in numbers(figure)]
    return [figures]


def test_the_table_stands_beside_the_papers(call: Call, loop: Path) -> None:
    other = Path("other.log")
    other.write_bytes(loop.read_bytes())
    status, out, err = call("evaluate", loop, other, "--queries", 4, "--profile", "paper")
    assert (status, err) == (0, "") and "profile paper" in out
    rows = [line.split() for line in out.splitlines()]
    ranks, _, wrong = (row for row in rows if row[:1] == ["fr079-simulated"])
    assert ranks[-2:] == ["24.0", "17.1"]
    assert next(row[-2:] for row in rows if row[:1] == ["other"]) == ["–", "–"]
    assert wrong[-2:] == ["of", "4"]  # queries, looked up in the other log
    assert sum(row[:1] == ["mean"] for row in rows) == 3


def test_the_same_figures_for_any_number_of_jobs(loop: Path, evaluation: Evaluation) -> None:
    again = evaluate(EvaluationRequest([loop], queries=16, jobs=2))
    assert again.datasets[0].judgements == evaluation.datasets[0].judgements
    assert again.datasets[0].pairs[0].scores == evaluation.datasets[0].pairs[0].scores


def test_the_seed_draws_the_queries(loop: Path, evaluation: Evaluation) -> None:
    drawn = [judgement.query for judgement in evaluation.datasets[0].judgements]
    assert len(drawn) == 16 and drawn == sorted(set(drawn))
    truth = evaluation.datasets[0].truth
    assert set(drawn) < set(truth.queries().tolist())
    assert all(j.relevant == truth.relevance(j.query)[0].sum() for j in evaluation.datasets[0].judgements)


def test_the_default_profile_keeps_its_recall_on_a_simulated_log(evaluation: Evaluation) -> None:
    figures = methods(evaluation.datasets[0].judgements)
    assert figures["bow"]["anr"] < 50 and figures["m2t"]["anr"] < 4
    assert figures["m2t"]["recall_at_1"]["1"] <= figures["m2t"]["recall_at_1"]["3"]
    verified = figures["verified"]
    assert verified["recall_at_1"]["3"] > 88 and verified["verdict_precision"] > 96
    assert verified["translation_error_median"] < 0.06 and verified["rotation_error_median"] < math.radians(0.5)


@pytest.mark.long
def test_the_default_profile_keeps_its_recall_on_a_real_log(radish: Path) -> None:
    found = evaluate(EvaluationRequest([radish / "freiburg-101-corrected.log.gz"], queries=40, jobs=2))
    figures = methods(found.datasets[0].judgements)
    assert figures["m2t"]["anr"] < 5 and figures["bow"]["anr"] > 15
    assert figures["verified"]["recall_at_1"]["3"] > 95 and figures["verified"]["verdict_precision"] > 98


def test_examples(evaluation: Evaluation) -> None:
    relevant, irrelevant = evaluation.datasets[0].pairs
    assert relevant.relevant and not irrelevant.relevant and relevant.query == irrelevant.query
    assert relevant.found != irrelevant.found


def test_nothing_is_left_behind(loop: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def interrupt(what: str, stage: str, done: int, of: int) -> None:
        if stage == "judging queries":
            assert list(tmp_path.iterdir())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate(EvaluationRequest([loop], queries=2), interrupt)
    assert not list(tmp_path.iterdir())


def test_figures_of_judgements_by_hand() -> None:
    def judgement(rank: float, distance: float, verdict: str, error: float | None = None) -> Judgement:
        ranks, distances = {"bow": rank, "m2t": rank / 2}, dict.fromkeys(("bow", "m2t", "verified"), distance)
        right = error is not None and error < 0.2
        return Judgement(0, 1, ranks, distances, verdict, error and (error, error / 10), right)

    queries = [
        judgement(0.2, 0.5, "match", 0.1),
        judgement(0.4, 2.0, "match", 0.3),
        judgement(0.6, 9.0, "match"),
        judgement(0.8, np.inf, "none"),
    ]
    figures = methods(queries, unvisited=(7, 2), elsewhere=(5, 1))
    assert figures["bow"]["anr"] == pytest.approx(50) and figures["m2t"]["anr"] == pytest.approx(25)
    assert figures["verified"] == {
        "recall_at_1": {"1": 25.0, "3": 50.0},
        "translation_error_median": pytest.approx(0.2),
        "rotation_error_median": pytest.approx(0.02),
        "verdict_precision": pytest.approx(200 / 3),
        "verdict_recall": 50.0,
        "pose_recall": 25.0,
        "match_precision": pytest.approx(100 / 5),  # one of three matches is right, none of two is
        "match_recall": 25.0,
        "unvisited": 7,
        "unvisited_matches": 2,
        "elsewhere": 5,
        "elsewhere_matches": 1,
    }
    silent = methods([judgement(0.8, np.inf, "none")])["verified"]
    assert silent["verdict_precision"] is None and silent["translation_error_median"] is None
    assert silent["match_precision"] is None


def test_mean_over_datasets() -> None:
    assert mean([{"a": {"b": 1.0}, "c": None}, {"a": {"b": 4.0}, "c": 2.0}]) == {"a": {"b": 2.5}, "c": 2.0}
    assert mean([{"a": None}]) == {"a": None}


@pytest.mark.parametrize(
    ("name", "figures"),
    [
        ("freiburg-079-corrected", (24.0, 17.1)),
        ("fr101", (32.6, 16.7)),
        ("Albert-B", (35.0, 26.6)),
        ("abuilding_2", (29.3, 7.0)),
        ("kwing1", (18.7, 3.6)),
        ("run1.raw", (41.7, 15.2)),
        ("run12", None),
        ("intel-corrected", None),
        ("my-fr079", None),
    ],
)
def test_published(name: str, figures: tuple[float, float] | None) -> None:
    assert published(name) == (figures and {"bow": figures[0], "m2t": figures[1]})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Missing argument"),
        (["missing.log"], "'missing.log' does not exist"),
        (["."], "is a folder; name the files in it; nothing was evaluated"),
        (["LOG", "--profile", "papper"], "no profile 'papper'; there are default, paper"),
        (["LOG", "--queries", "0"], "--queries"),
        (["LOG", "--seed", "-1"], "--seed"),
        (["LOG", "--jobs", "0"], "--jobs"),
        (["LOG", "LOG"], "2 sources would be the dataset 'fr079-simulated'"),
        (["LOG", "--plot", "blind.log"], "cannot make the folder"),
        (["LOG", "blind.log"], "blind.log' has no ground truth to judge by"),
        (["once.log"], "name a log that comes back to places"),
        (["short.log"], "name a log that comes back to places"),
    ],
)
def test_a_wrong_call_gets_one_line(
    call: Call, loop: Path, unusable: dict[str, Path], arguments: list[str], message: str
) -> None:
    logs = unusable | {"LOG": loop}
    status, out, err = call("evaluate", *(logs.get(argument, argument) for argument in arguments))
    assert (status, out) == (2, "") and message in err
    assert err.startswith("m2t-text: ") and err.count("\n") == 1
