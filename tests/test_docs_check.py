"""What `make docs-check` takes for a stale output, and how it writes it anew."""

from pathlib import Path

import docs_check
import pytest

SHOWN = """# A page

<!-- docs-check: first touch b -->
```text
$ ls
a
b

$ echo "in 0.31 s"
in 7.02 s
```

```text
not a command
```

<!-- docs-check: skip it needs luck -->
```text
$ false
```
"""


def test_blocks_with_commands_are_found() -> None:
    first, second = docs_check.blocks(SHOWN)
    assert first.first == ["touch b"] and not first.skip and second.skip
    assert [command for command, _ in first.shown] == ["ls", 'echo "in 0.31 s"']


def test_every_page_that_shows_a_command_is_checked() -> None:
    for page in docs_check.PAGES:
        text = page.read_text(encoding="utf-8")
        shown = sum(len(block.shown) for block in docs_check.blocks(text) if not block.whole)
        assert shown == sum(line.lstrip().startswith("$ ") for line in text.splitlines()), page.name


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("searched in 0.31 s", "searched in 12.02 s", True),
        ("20 loops", "17 loops", False),
        ("  map     score", "  map  score", True),
        ("  maps   seconds\n  ─────\n  287    4.4", "  maps   seconds\n  ──────\n  287   10.4", True),
        ("  maps   seconds\n  ─────\n  287    4.4", "  maps   seconds\n  ─────\n  288    4.4", False),
        ("  seconds\n  4.4\n\n287", "  seconds\n  4.4\n\n288", False),
        ("verdict: match", "verdict: ambiguous", False),
    ],
)
def test_only_what_varies_is_masked(shown: str, printed: str, same: bool) -> None:
    assert (docs_check.masked(shown.splitlines()) == docs_check.masked(printed.splitlines())) == same


def test_a_stale_output_is_told_and_written_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(docs_check, "LOGS", [])
    page = tmp_path / "page.md"
    page.write_text(SHOWN)
    assert docs_check.check(page, update=False, cheap=False) == 1
    assert page.read_text() == SHOWN and "page.md: $ ls" in capsys.readouterr().out
    assert docs_check.check(page, update=True, cheap=False) == 1
    assert docs_check.check(page, update=False, cheap=False) == 0
    assert page.read_text() == SHOWN.replace("$ ls\na\nb\n", "$ ls\nb\ndocs\n")
