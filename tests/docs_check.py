"""Runs the commands that README and docs show, and compares what they print with what the pages say.

    python tests/docs_check.py [--update] [--cheap] [PAGE...]

Each page gets a scratch folder with the public logs in it, and its commands run there one after the other:
those that begin with ``$ `` in its blocks of the kind ``text``. What is as it happens to be (seconds, names of
files) is not compared, nor are widths of columns. A comment before a block says what the page does not show:

    <!-- docs-check: first COMMAND -->    runs a command first; may be repeated
    <!-- docs-check: prints COMMAND -->   the whole block is what this command prints
    <!-- docs-check: slow -->             left out with --cheap
    <!-- docs-check: skip REASON -->      cannot be run
"""

import argparse
import difflib
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
LOGS = sorted((ROOT.parent / "shared" / "data").glob("*/*.log.gz"))
BLOCK = re.compile(r"((?:^<!-- docs-check: [^\n]* -->\n)*)^( *)```text\n(.*?)^\2```$", re.MULTILINE | re.DOTALL)
REMARK = re.compile(r"<!-- docs-check: (first|prints|slow|skip) ?(.*) -->")
VARYING = (
    (re.compile(r"\b[\d.,]+ (ms|s)\b"), r"# \1"),
    (re.compile(r"\bMAIN_[0-9a-z]{16}\b"), "MAIN_#"),
    (re.compile(r"─+"), "─"),
    (re.compile(r" {2,}"), "  "),
)
COMPILING = "compiling once for this machine"  # is printed by whichever command comes first
LIMIT = 900  # s for one command


@dataclass(frozen=True)
class Block:
    """A block of a page: what is to be run before, and each command with what the page says that it prints."""

    span: tuple[int, int]  # of what is between the fences
    indent: str
    first: list[str]
    shown: list[tuple[str, list[str]]]
    whole: bool = False  # whether the command itself is not shown
    slow: bool = False
    skip: bool = False
    gaps: list[bool] = field(default_factory=list)  # whether an empty line stands before the command


def blocks(page: str) -> list[Block]:
    """The blocks of a page that show commands."""
    found = []
    for match in BLOCK.finditer(page):
        remarks = REMARK.findall(match[1])
        texts: dict[str, list[str]] = {kind: [text for k, text in remarks if k == kind] for kind, _ in remarks}
        indent = match[2]
        lines = [line.removeprefix(indent) for line in match[3].splitlines()]
        shown: list[tuple[str, list[str]]] = []
        gaps: list[bool] = []
        if "prints" in texts:
            shown, gaps = [(texts["prints"][0], lines)], [False]
        else:
            for before, line in zip(["", *lines], lines, strict=False):
                if line.startswith("$ "):
                    gaps.append(bool(shown) and not before)
                    shown.append((line[2:], []))
                elif shown:
                    shown[-1][1].append(line)
        if shown:
            flags = "prints" in texts, "slow" in texts, "skip" in texts
            found.append(Block(match.span(3), indent, texts.get("first", []), shown, *flags, gaps))
    return found


def masked(lines: list[str]) -> list[str]:
    """Lines without what varies: seconds wherever they stand, and widths."""
    result, seconds = [], False
    for line in lines:
        if not line.strip():
            seconds = False
            continue
        if seconds:
            line = re.sub(r"[\d.,]+\s*$", "#", line)  # noqa: PLW2901
        seconds = seconds or bool(re.search(r"\bseconds\s*$", line))
        for pattern, instead in VARYING:
            line = pattern.sub(instead, line)  # noqa: PLW2901
        result.append(line.strip())
    return result


def tidy(printed: str) -> list[str]:
    """What was printed, without blanks at the ends of lines and without empty lines at its ends or in a row."""
    lines = [line.rstrip() for line in printed.splitlines() if line != COMPILING]
    kept = [line for before, line in zip(["", *lines], lines, strict=False) if line or before]
    return kept[:-1] if kept and not kept[-1] else kept


def written(block: Block, printed: list[list[str]]) -> str:
    """The block as it should be."""
    lines: list[str] = []
    for (command, _), output, gap in zip(block.shown, printed, block.gaps, strict=True):
        ended = output[:-1] if output and not output[-1] else output  # the gap before the next command
        lines += ([""] if gap else []) + ([] if block.whole else [f"$ {command}"]) + ended
    return "".join(f"{block.indent}{line}".rstrip() + "\n" for line in lines)


def run(command: str, folder: Path) -> list[str]:
    """What a shell prints for a command, with errors."""
    environment = os.environ | {
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests" / "helpers")]),
        "PYTHONUTF8": "1",
        "PYTHONUNBUFFERED": "1",  # so that errors stand where they happen
        "M2T_CACHE": str(folder / "cache"),
    }
    environment.pop("M2T_INDEX", None)
    line = ["bash", "-c", command]
    done = subprocess.run(
        line, cwd=folder, env=environment, stdout=-1, stderr=-2, text=True, timeout=LIMIT, check=False
    )
    return tidy(done.stdout)


def check(page: Path, update: bool, cheap: bool) -> int:
    """Runs a page's commands; returns how many blocks differ, after they were written anew if that is asked."""
    text = page.read_text(encoding="utf-8")
    stale, new = 0, text
    with TemporaryDirectory() as name:
        folder = Path(name)
        for log in LOGS:
            (folder / log.name).symlink_to(log)
        (folder / "docs").mkdir()
        (folder / ".venv").symlink_to(Path(sys.executable).parents[1])
        for block in blocks(text):
            if block.skip or (cheap and block.slow):
                continue
            for command in block.first:
                run(command, folder)
            printed = [run(command, folder) for command, _ in block.shown]
            differs = False
            for (command, expected), output in zip(block.shown, printed, strict=True):
                before, now = masked(expected), masked(output)
                if before == now:
                    output[:] = expected  # seconds of a quiet machine stay
                else:
                    differs = True
                    print(f"{page.name}: $ {command}")
                    print(*list(difflib.unified_diff(before, now, lineterm="", n=0))[2:], sep="\n")
            stale += differs
            if any(line.startswith("Traceback ") for output in printed for line in output):
                print(f"{page.name}: a traceback is a fault, and is not written")
            elif differs and update:
                old = text[block.span[0] : block.span[1]]
                new = new.replace(old, written(block, printed))
        if update:
            page.write_text(new, encoding="utf-8")
            for picture in (folder / "docs").glob("*.png"):
                shutil.copy(picture, ROOT / "docs")
    return stale


def main() -> None:
    parser = argparse.ArgumentParser(description="Checks the outputs that README and docs show.")
    parser.add_argument("pages", nargs="*", type=Path, default=PAGES)
    parser.add_argument("--update", action="store_true", help="write them anew")
    parser.add_argument("--cheap", action="store_true", help="leave out what takes long")
    options = parser.parse_args()
    if not LOGS:
        print("the public logs are not in ../shared/data: nothing is checked")
        return
    stale = {page: check(page.resolve(), options.update, options.cheap) for page in options.pages}
    for page, count in stale.items():
        if count:
            print(f"{page.name}: {count} {'written anew' if options.update else 'stale'}")
    sys.exit(any(stale.values()) and not options.update)


if __name__ == "__main__":
    main()
