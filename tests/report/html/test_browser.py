"""The page in a browser: sorting, filtering, both colour schemes, a phone, the keyboard, and no request to anywhere."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium on this machine")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def address(written: Path) -> str:
    return written.as_uri()


class Opened:
    """The page, with what it said on the console and what it asked for."""

    def __init__(self, page: Any, address: str) -> None:
        self.page, self.said, self.asked = page, list[str](), list[str]()
        page.on("console", lambda message: self.said.append(message.text))
        page.on("pageerror", lambda error: self.said.append(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))
        page.goto(address)

    def heading(self, name: str) -> Any:
        """The heading `name` of the first table of the leaderboard."""
        return self.page.locator("#leaderboard table >> nth=0").locator("thead th").filter(has_text=name).first

    def column(self, name: str) -> list[str]:
        """The texts below it, of the rows in sight."""
        index = self.heading(name).evaluate("head => head.cellIndex + 1")
        rows = self.page.locator("#leaderboard table >> nth=0").locator("tbody tr:visible")
        return [text.strip() for text in rows.locator(f"td:nth-child({index})").all_inner_texts()]


@pytest.fixture
def opened(browser: Any, address: str, request: pytest.FixtureRequest) -> Iterator[Opened]:
    """The page, in a new window of what the test asks for."""
    context = browser.new_context(**getattr(request, "param", {}))
    yield Opened(context.new_page(), address)
    context.close()


PHONE = {"viewport": {"width": 400, "height": 800}}


@pytest.mark.parametrize("opened", [{}, PHONE, {"color_scheme": "dark"}], ids=["wide", "phone", "dark"], indirect=True)
def test_it_opens_without_a_word_a_request_or_scrolling_sideways(opened: Opened, address: str) -> None:
    assert opened.said == []
    assert [url for url in opened.asked if not url.startswith("data:")] == [address]
    assert opened.page.title() == "run · causalbench"
    width = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    for fold in opened.page.locator("details").all():
        fold.evaluate("fold => { fold.open = true }")
    assert opened.page.evaluate(width) == 0
    assert opened.page.evaluate("typeof boom") == "undefined"
    first = "performance.getEntriesByName('first-contentful-paint')[0].startTime"
    assert opened.page.evaluate(first) < 5_000  # ms; a second on a machine that does nothing else


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_both_colour_schemes_can_be_read(browser: Any, address: str, scheme: str) -> None:
    context = browser.new_context(color_scheme=scheme)
    opened = Opened(context.new_page(), address)
    ground, ink, drawn = opened.page.evaluate(
        "() => [getComputedStyle(document.body).backgroundColor, getComputedStyle(document.body).color,"
        " getComputedStyle(document.querySelector('#curves svg text')).fill]"
    )
    assert contrast(ground, ink) > 7
    assert drawn == ink
    assert (luminance(ground) > 0.5) == (scheme == "light")
    for part in (".facts .warn", ".verdict.better b", ".verdict.worse b", ".lead", "th", "a"):
        pair = opened.page.locator(part).first.evaluate(
            "part => [getComputedStyle(part).backgroundColor, getComputedStyle(part).color]"
        )
        assert contrast(ground if pair[0] == "rgba(0, 0, 0, 0)" else pair[0], pair[1]) > 4.5, part
    context.close()


def luminance(colour: str) -> float:
    """WCAG's relative luminance of "rgb(r, g, b)"."""
    channels = [int(part) / 255 for part in colour[4:-1].split(",")]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_a_table_is_sorted_by_number_and_missing_ones_stay_last(opened: Opened) -> None:
    before, heading = opened.column("success AUC"), opened.heading("success AUC")
    assert "\N{EN DASH}" in before  # a method of which nothing is finished
    heading.get_by_role("button").click()
    assert heading.get_attribute("aria-sort") == "ascending"
    up = opened.column("success AUC")
    numbers = [float(text.split()[0]) for text in up if text != "\N{EN DASH}"]
    assert numbers == sorted(numbers)
    assert up[-1] == "\N{EN DASH}"
    heading.get_by_role("button").click()
    down = opened.column("success AUC")
    assert [float(text.split()[0]) for text in down if text != "\N{EN DASH}"] == numbers[::-1]
    assert down[-1] == "\N{EN DASH}"
    assert sorted(down) == sorted(before)


def test_the_keyboard_sorts_too(opened: Opened) -> None:
    opened.heading("method").get_by_role("button").focus()
    opened.page.keyboard.press("Enter")
    names = opened.column("method")
    assert names == sorted(names, key=str.lower)
    opened.page.keyboard.press("Space")
    assert opened.column("method") == names[::-1]


def test_filters_hide_a_backend_and_a_method_everywhere(opened: Opened) -> None:
    page = opened.page
    assert page.locator("#curves figure:visible").count() == 5  # kinematic has a point of a grid
    page.get_by_role("checkbox", name="physical", exact=True).uncheck()
    assert page.locator("[data-backend=physical]:visible").count() == 0
    assert page.locator("#curves figure:visible").count() == 3
    page.get_by_role("checkbox", name="m", exact=True).uncheck()
    assert page.locator("#curves figure:visible").count() == 1
    assert opened.column("method") == ["cm", "unlucky"]
    page.get_by_role("checkbox", name="physical", exact=True).check()
    page.get_by_role("checkbox", name="m", exact=True).check()
    assert page.locator("#curves figure:visible").count() == 5


def test_the_data_of_a_figure_can_be_saved(opened: Opened, tmp_path: Path) -> None:
    with opened.page.expect_download() as saved:
        opened.page.get_by_role("link", name="curves-physical.csv").click()
    saved.value.save_as(tmp_path / saved.value.suggested_filename)
    lines = (tmp_path / "curves-physical.csv").read_text().splitlines()
    assert lines[0].startswith("backend,method,grid_point,env_steps,success")
    assert len(lines) == 1 + 2 * 3


def test_a_film_plays_with_its_ribbon_in_step(opened: Opened) -> None:
    film = opened.page.locator(".film")
    assert film.locator("figcaption").inner_text() == "cm on physical, seed 0"
    assert film.locator("output").inner_text() == "stage 1 of 3"
    video = film.locator("video")
    seconds = video.evaluate(
        "video => new Promise(done => { video.onseeked = () => video.play();"
        " video.ontimeupdate = () => { if (video.currentTime > 2.2) { video.pause(); done(video.duration); } };"
        " video.currentTime = 1.9; })"
    )
    assert seconds == pytest.approx(3.0, abs=0.15)
    opened.page.wait_for_function("document.querySelector('.film output').textContent === 'stage 2 of 3'")
    at = video.evaluate("video => 100 * video.currentTime / video.duration")
    needle = float(film.locator(".ribbon b").evaluate("needle => needle.style.left").rstrip("%"))
    assert needle == pytest.approx(at, abs=10)
    box = film.locator(".ribbon").bounding_box()
    film.locator(".ribbon").click(position={"x": box["width"] / 6, "y": 5})
    opened.page.wait_for_function("document.querySelector('.film output').textContent === 'stage 1 of 3'")
    assert opened.said == []


@pytest.mark.parametrize("opened", [{}, PHONE], ids=["wide", "phone"], indirect=True)
def test_a_link_to_a_section_shows_its_heading_and_not_the_filters_over_it(opened: Opened) -> None:
    opened.page.locator("nav a[href='#leaderboard']").click()
    heading = opened.page.locator("#leaderboard h2").first
    assert heading.evaluate(
        "head => { const box = head.getBoundingClientRect();"
        " return head.contains(document.elementFromPoint(box.left + 5, box.top + box.height / 2)); }"
    )
