"""What the site has beside the pages in this folder: the README as its home, the notebooks, the commands' help.

Links between all these are written as for the source tree, and made links of the site here.
"""

import os
import posixpath
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
ORDER = (
    "public-logs",
    "bags",
    "point-clouds",
    "saved-maps",
    "web",
    "indexes",
    "cluster",
    "loops",
    "ros2",
    "mapping",
    "architecture",
    "trust",
    "speed",
)  # then others
LINK = re.compile(r"(?<=\]\()(?!#|[a-z]+:)([^)#\s]+)")  # relative targets, without their anchors
WIDTH = 100  # columns of a command's help
SHIM = "assets/iframe-worker.js"


def on_config(config: "MkDocsConfig") -> None:
    """Navigation: first what to do, then how it works, then what to look up."""
    pages = {path.stem: path.name for path in sorted((ROOT / "docs").glob("*.md"))}
    looked_up = [
        {"Command line": "cli.md"},
        {"Python": pages.pop("api")},
        {"Python reference": pages.pop("reference")},
    ]
    ordered = [pages.pop(name) for name in ORDER if name in pages] + list(pages.values())
    notebooks = [f"notebooks/{path.stem}.md" for path in NOTEBOOKS]
    config.nav = [
        "index.md",
        {"Guides": ordered},
        {"Notebooks": notebooks},
        {"Reference": looked_up},
    ]
    # Browsers refuse workers to pages from disk. The theme would ask a server elsewhere for a script that
    # helps, were there none of that name here.
    config.extra["polyfills"] = [SHIM]


def on_files(files: "Files", config: "MkDocsConfig") -> None:
    """Adds the pages that are made and not written."""
    from mkdocs.structure.files import File

    made: dict[str, str | bytes] = {
        "index.md": (ROOT / "README.md").read_text(encoding="utf-8"),
        "cli.md": command_line(),
    }
    for path in NOTEBOOKS:
        made |= notebook(path)
    for name, content in made.items():
        files.append(File.generated(config, name, content=content))


def on_page_markdown(markdown: str, page: "Page", config: "MkDocsConfig", files: "Files") -> str:
    return relinked(markdown, page.file.src_uri)


def relinked(markdown: str, page: str) -> str:
    """The page with its links to files of the source tree made links to pages of the site."""
    source = posixpath.dirname(source_of(page))

    def link(match: re.Match[str]) -> str:
        target = page_of(posixpath.normpath(posixpath.join(source, match[1])))
        return posixpath.relpath(target, posixpath.dirname(page) or ".")

    return LINK.sub(link, markdown)


def source_of(page: str) -> str:
    """The file in the source tree that a page of the site is made from."""
    if page == "index.md":
        return "README.md"
    return page.removesuffix(".md") + ".ipynb" if page.startswith("notebooks/") else f"docs/{page}"


def page_of(source: str) -> str:
    """The page or picture of the site that a file in the source tree becomes."""
    if source == "README.md":
        return "index.md"
    return re.sub(r"\.ipynb$", ".md", source).removeprefix("docs/")


def command_line() -> str:
    """The help of the program and of each command, as a terminal shows it."""
    from m2t_text.cli.app import app

    callbacks = (
        command.name or getattr(command.callback, "__name__", "") for command in app.registered_commands
    )
    names = [name.replace("_", "-") for name in callbacks]  # as Typer does
    sections = [
        f"## m2t-text {name}\n\n```text\n{shown_help(name)}\n```\n"
        if name
        else f"```text\n{shown_help()}\n```\n"
        for name in ["", *names]
    ]
    return "\n".join(["# The command line\n", *sections])


def shown_help(*command: str) -> str:
    code = "from m2t_text.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *command, "--help"],
        env=os.environ | {"COLUMNS": str(WIDTH), "TERM": "dumb", "PYTHONPATH": str(ROOT), "PYTHONUTF8": "1"},
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    return "\n".join(line.rstrip() for line in done.stdout.splitlines()).strip()


def notebook(path: Path) -> dict[str, Any]:
    """A notebook as Markdown, with what it showed when it last ran, and its pictures."""
    import nbformat
    from nbconvert import MarkdownExporter

    pictures = f"{path.stem}_files"
    body, resources = MarkdownExporter().from_notebook_node(
        nbformat.read(path, as_version=4), {"output_files_dir": pictures}
    )
    return {f"notebooks/{path.stem}.md": body} | {
        f"notebooks/{name}": content for name, content in resources["outputs"].items()
    }
