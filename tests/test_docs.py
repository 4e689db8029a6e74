"""The pages of the documentation: their links lead somewhere, in the source tree and on the site."""

import re
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest
from markdown_it import MarkdownIt
from markdown_it.tree import SyntaxTreeNode

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    spec = spec_from_file_location("hooks", ROOT / "docs" / "hooks.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def tree(path: Path) -> SyntaxTreeNode:
    return SyntaxTreeNode(MarkdownIt("commonmark").enable("table").parse(path.read_text(encoding="utf-8")))


def links(path: Path) -> list[str]:
    """What a page links to or shows, but for addresses on the web."""
    targets = [
        str(node.attrs.get("href", node.attrs.get("src", ""))) for node in tree(path).walk(include_self=False)
    ]
    return [target for target in targets if target and not re.match(r"[a-z]+:", target)]


def anchors(path: Path) -> set[str]:
    """Of its headings, as both the site and source hosts make them."""
    titles = [node.children[0].content for node in tree(path).walk() if node.type == "heading"]
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for link in links(page):
        target, _, anchor = link.partition("#")
        file = (page.parent / target).resolve() if target else page
        assert file.is_file(), link
        assert file == PAGES[0] or file.parent in (ROOT / "docs", ROOT / "notebooks"), (
            f"{link} is not on the site"
        )
        assert not anchor or anchor in anchors(file), link


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_page_has_one_title(page: Path) -> None:
    headings = [node.tag for node in tree(page).walk() if node.type == "heading"]
    assert headings and headings[0] == "h1" and headings.count("h1") == 1


def test_the_readme_links_somewhere() -> None:
    """Else the tests above would see nothing."""
    assert {"docs/match.png", "#on-your-own-log"} <= set(links(ROOT / "README.md"))


@pytest.mark.parametrize(
    ("page", "markdown", "expected"),
    [
        ("index.md", "![a](docs/match.png) [b](#try-it)", "![a](match.png) [b](#try-it)"),
        (
            "index.md",
            "[a](notebooks/01_x.ipynb) [b](docs/trust.md#how)",
            "[a](notebooks/01_x.md) [b](trust.md#how)",
        ),
        ("trust.md", "[a](../README.md#try-it) [b](loops.md)", "[a](index.md#try-it) [b](loops.md)"),
        ("trust.md", "[a](../notebooks/01_x.ipynb)", "[a](notebooks/01_x.md)"),
        ("notebooks/01_x.md", "[a](../README.md) [b](02_y.ipynb)", "[a](../index.md) [b](02_y.md)"),
        ("notebooks/01_x.md", "![png](01_x_files/a.png)", "![png](01_x_files/a.png)"),
        ("index.md", "[a](https://example.org/docs/a.md)", "[a](https://example.org/docs/a.md)"),
    ],
)
def test_links_of_the_source_tree_become_links_of_the_site(
    hooks: ModuleType, page: str, markdown: str, expected: str
) -> None:
    assert hooks.relinked(markdown, page) == expected


def test_the_help_of_each_command_is_a_section(hooks: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hooks, "shown_help", lambda *command: f"help of {command}")
    page = hooks.command_line()
    for command in ("demo", "search", "fetch", "optimize"):
        assert f"## m2t-text {command}\n\n```text\nhelp of ('{command}',)\n```\n" in page


def test_help_is_shown_as_in_a_terminal(hooks: ModuleType) -> None:
    shown = hooks.shown_help("fetch")
    assert (
        shown.startswith("Usage: m2t-text fetch") and "m2t-text index $(m2t-text fetch radish/fr079)" in shown
    )
    assert "\x1b" not in shown and max(map(len, shown.splitlines())) <= hooks.WIDTH


class Config:
    """Of MkDocs, what the hooks change."""

    def __init__(self) -> None:
        self.nav: list[object] = []
        self.extra: dict[str, object] = {}


def test_nothing_is_loaded_from_elsewhere(hooks: ModuleType) -> None:
    """The offline plugin adds the address of a server, if no script is called so."""
    config = Config()
    hooks.on_config(config)
    (script,) = config.extra["polyfills"]
    assert "iframe-worker" in script and (ROOT / "docs" / script).is_file()
    written = [path.read_text(encoding="utf-8") for path in PAGES]
    assert not any(re.search(r"<script|<link|!\[[^]]*\]\(https?:", text) for text in written)


def test_no_page_links_to_a_package_registry() -> None:
    assert not any(re.search(r"pypi\.org|npmjs|anaconda\.org", path.read_text()) for path in PAGES)


def test_the_navigation_has_every_page(hooks: ModuleType) -> None:
    config = Config()
    hooks.on_config(config)
    shown = re.findall(r"'([^']*\.md)'", str(config.nav))
    written = [path.name for path in (ROOT / "docs").glob("*.md")]
    notebooks = [f"notebooks/{path.stem}.md" for path in (ROOT / "notebooks").glob("*.ipynb")]
    assert sorted(shown) == sorted([*written, *notebooks, "index.md", "cli.md"])
    assert notebooks and shown[0] == "index.md"
