"""Chromium, driven by Playwright, where both are there."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

PLACES = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = ["--no-sandbox", "--disable-background-networking", "--disable-component-update"]


def chromium() -> str | None:
    """Where the browser is."""
    return next((path for name in PLACES if (path := shutil.which(name))), None)


def missing() -> str | None:
    """Why no browser can be driven; None if one can."""
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError:
        return "Playwright is not installed: pip install playwright"
    return None if chromium() else "there is no Chromium: apt-get install chromium"


@contextmanager
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=chromium(), args=ARGUMENTS)
        try:
            yield opened
        finally:
            opened.close()


def wait(page: Any, condition: str, seconds: float = 60.0) -> Any:
    """Waits until an expression is true in a page, whose own policy forbids Playwright's way of doing so."""
    for _ in range(int(seconds * 50)):
        value = page.evaluate(condition)
        if value:
            return value
        page.wait_for_timeout(20)
    raise AssertionError(f"not within {seconds} s: {condition}")
