"""The fuzzer's targets for seconds: sound inputs, those that once broke something, and random damage."""

from pathlib import Path

import pytest
from fuzz import fuzzed
from hypothesis import given, settings
from hypothesis import strategies as st
from targets import TARGETS, tried

FOUND = Path(__file__).with_name("found")
OWN_TESTS = {"carmen", "carmen-gzip", "bag", "db3", "mcap", "pcd", "ply", "npy", "xyz", "csv"}  # of the readers
SLOW = {"parts", "messages"}  # a tenth of a second for an input


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where inputs are put; what is made beside it stays for all of them."""
    folder = tmp_path_factory.mktemp("fuzz") / "inputs"
    folder.mkdir()
    return folder


@pytest.fixture(autouse=True)
def _back(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One target changes to the folder of its inputs."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", TARGETS)
def test_sound_inputs_get_past_the_door(folder: Path, name: str) -> None:
    """Or the fuzzer would only ever fuzz the door. The bags are too short for a map, which is told last."""
    target = TARGETS[name]
    told = [tried(target, seed, folder) for seed in target.seeds(folder).values()]
    assert None in told or all("travels less than" in (one or "") for one in told), told


@pytest.mark.parametrize("path", sorted(FOUND.glob("*/*")), ids=lambda path: f"{path.parent.name}-{path.name}")
def test_what_was_found_is_mended(folder: Path, path: Path) -> None:
    tried(TARGETS[path.parent.name], path.read_bytes(), folder)


@pytest.mark.parametrize("at", range(30))
def test_a_length_beyond_any_in_a_table_of_contents_is_refused(folder: Path, at: int) -> None:
    """Found as a flipped byte that makes a number of variable length go on."""
    target = TARGETS["index"]
    for name, seed in target.seeds(folder).items():
        if name.endswith(".toc"):
            tried(target, seed[: at + 1] + b"\xff" * 12 + b"\x7f" + seed[at + 2 :], folder)


@pytest.mark.parametrize("name", sorted(TARGETS.keys() - OWN_TESTS))
def test_damage_is_read_or_refused(folder: Path, name: str) -> None:
    @settings(max_examples=5 if name in SLOW else 30, deadline=None)
    @given(data=st.data())
    def check(data: st.DataObject) -> None:
        damage(folder, name, data)

    check()


def damage(folder: Path, name: str, data: st.DataObject) -> None:
    target = TARGETS[name]
    seeds = target.seeds(folder)
    content = bytearray(data.draw(st.sampled_from(sorted(seeds.values()))))
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place : place + data.draw(st.integers(0, 2))] = data.draw(st.binary(max_size=3))
        content = content or bytearray(b" ")
    tried(target, bytes(content), folder)


@pytest.mark.long
def test_the_fuzzer_fuzzes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("atheris")
    monkeypatch.setattr("fuzz.FINDINGS", tmp_path / "findings")
    row, sound = fuzzed("xyz", 200, None, tmp_path)
    assert sound and row[:2] == ["xyz", "200"]
