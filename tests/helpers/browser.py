"""A real browser, for tests of pages."""

from __future__ import annotations

import shutil
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
QUIET = (
    "--no-sandbox --disable-quic --no-first-run --disable-background-networking --disable-component-update "
    "--disable-sync"
)


@contextmanager
def launched(options: str) -> Iterator[Any]:
    """Context manager: a browser with these options; the test is skipped where there is none."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no browser on the path: none of {', '.join(BROWSERS)}")
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=found, args=f"{QUIET} {options}".split())
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launched("--disable-gpu") as chromium:
        yield chromium


class Tabs:
    """Tabs in which tests open pages, one after the other: a window of its own for each takes three times as long."""

    def __init__(self, browser: Any) -> None:
        self.browser, self.free, self.taken = browser, defaultdict[bool, list[Any]](list), list[Any]()
        self.noise, self.addresses = list[str](), set[str]()
        self.expected: tuple[str, ...] = ()  # how noise begins that the test at hand makes itself

    def open(
        self,
        address: str,
        *,
        viewport: dict[str, int],
        color_scheme: str = "light",
        reduced_motion: str = "no-preference",
        java_script_enabled: bool = True,
    ) -> Any:
        free = self.free[java_script_enabled]
        page = free.pop() if free else self.new(java_script_enabled)
        self.taken.append((java_script_enabled, page))
        page.set_viewport_size(viewport)
        page.emulate_media(media="null", color_scheme=color_scheme, reduced_motion=reduced_motion)
        self.addresses.add(address.partition("#")[0])
        page.goto(address)
        return page

    def new(self, java_script_enabled: bool) -> Any:
        page = self.browser.new_context(java_script_enabled=java_script_enabled).new_page()
        page.on("console", lambda message: self.noise.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: self.noise.append(f"error: {error}"))
        page.on("dialog", self.asks)
        page.on("request", lambda request: self.asked(request.url))
        return page

    def asks(self, dialog: Any) -> None:
        self.noise.append(f"dialog: {dialog.message}")
        dialog.dismiss()

    def asked(self, url: str) -> None:
        if url.partition("#")[0] not in {"about:blank", *self.addresses}:
            self.noise.append(url)

    def emptied(self) -> list[str]:
        """Whatever the pages of a test logged or asked for but themselves; their tabs are free again."""
        for java_script_enabled, page in self.taken:
            page.goto("about:blank")
            page.mouse.move(0, 0)
            self.free[java_script_enabled].append(page)
        noise = [one for one in self.noise if not one.startswith(self.expected)]
        self.noise, self.addresses, self.taken, self.expected = [], set(), [], ()
        return noise


@pytest.fixture(scope="module")
def tabs(browser: Any) -> Tabs:
    return Tabs(browser)
