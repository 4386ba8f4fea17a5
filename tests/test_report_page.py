"""Page of the report in a real browser: complete, visible, without requests to other servers, with an empty console.

The page is `$WHISKER_REPORT`, or else every `results/*/index.html`. Without Chromium or a page the tests are skipped with the
reason, or fail if `WHISKER_REQUIRE_BROWSER=1`.
"""

import csv
import functools
import http.server
import json
import os
import re
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CHROMIUM_FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
VIEWPORTS = {"desktop": {"width": 1280, "height": 900}, "phone": {"width": 390, "height": 844}}


def report_pages() -> list[Path]:
    """Pages to be tested; if there is none, the path of a missing one, for the reason of the skipped tests."""
    named = os.environ.get("WHISKER_REPORT")
    if named:
        return [Path(named).resolve()]
    return sorted(ROOT.glob("results/*/index.html")) or [ROOT / "results" / "standard" / "index.html"]


def unavailable(reason: str) -> None:
    """Skips the test, or fails if a browser is required."""
    if os.environ.get("WHISKER_REQUIRE_BROWSER") == "1":
        pytest.fail(reason)
    print(f"skipped: {reason}")
    pytest.skip(reason)


@pytest.fixture(scope="module")
def browser() -> Iterator:
    """Chromium, headless."""
    executable = shutil.which("chromium") or shutil.which("chromium-browser")
    if executable is None:
        unavailable("no chromium on the PATH (Debian: apt-get install chromium)")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        unavailable("the Python package playwright is not installed")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=CHROMIUM_FLAGS)
        yield browser
        browser.close()


class QuietHandler(http.server.SimpleHTTPRequestHandler):
    """Serves files without logging."""

    def log_message(self, format: str, *args: object) -> None:
        """Writes no log."""


@pytest.fixture(params=report_pages(), ids=lambda page: page.parent.name)
def report(request: pytest.FixtureRequest) -> Path:
    """File of a page."""
    page: Path = request.param
    if not page.is_file():
        unavailable(f"{page} does not exist; draw it with: whisker report {page.parent}")
    return page


@pytest.fixture
def address(report: Path) -> Iterator[str]:
    """Address of the page, served from its folder on loopback, so that all requests of the page are observed."""
    handler = functools.partial(QuietHandler, directory=str(report.parent))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/{report.name}"
        server.shutdown()


@pytest.fixture(params=VIEWPORTS)
def opened(browser, address: str, request: pytest.FixtureRequest) -> Iterator:
    """The loaded page with lists of its console messages and requests."""
    page = browser.new_page(viewport=VIEWPORTS[request.param])
    page.console_lines, page.requests = [], []
    page.on("console", lambda message: page.console_lines.append(message.text))
    page.on("pageerror", lambda error: page.console_lines.append(str(error)))
    page.on("request", lambda sent: page.requests.append(sent.url))
    page.goto(address, wait_until="networkidle")
    page.evaluate("document.fonts.ready")
    yield page
    page.close()


def test_verif_there_are_no_requests_and_the_console_is_empty(opened, address):
    outside = [url for url in opened.requests if url != address and not url.startswith("data:")]
    assert outside == []
    assert opened.console_lines == []


def test_verif_every_figure_is_visible(opened, report):
    names = sorted(drawing.stem for drawing in (report.parent / "figures").glob("*.svg"))
    assert len(names) >= 4
    assert opened.locator("figure svg").count() == len(names)
    for name in names:
        assert (report.parent / "figures" / f"{name}.png").stat().st_size > 10_000, name
        drawing = opened.locator(f"section#{name} figure svg")
        drawing.scroll_into_view_if_needed()
        assert drawing.is_visible(), name
        box = drawing.bounding_box()
        assert box["width"] >= 600, (name, box)
        assert box["height"] >= 200, (name, box)
        assert drawing.locator("polyline, polygon, circle").count() >= 20, name
        assert len(opened.locator(f"section#{name} figcaption").inner_text()) > 60, name


def test_verif_figures_of_all_methods_are_collapsed_and_open_without_scripts(browser, address, report):
    page = browser.new_page(java_script_enabled=False, viewport=VIEWPORTS["desktop"])
    page.goto(address)
    drawings = page.locator("details.all svg")
    assert drawings.count() == len(list((report.parent / "figures" / "all").glob("*.svg")))
    for collapsed in page.locator("details.all").all():
        contents = collapsed.locator(":scope > :not(summary)")
        assert not contents.first.is_visible()
        collapsed.locator(":scope > summary").click()
        assert contents.first.is_visible()
    for drawing in drawings.all():
        assert drawing.bounding_box()["width"] >= 600
    page.close()


def test_verif_the_summary_comes_first(opened):
    assert opened.locator("main section").first.get_attribute("id") == "summary"


def test_verif_the_stills_of_sweeps_link_to_their_animations(opened, address, report):
    animations = sorted(file.name for file in (report.parent / "animations").glob("*.webp"))
    links = opened.locator("section#sweeps a")
    assert sorted(link.get_attribute("href") for link in links.all()) == [f"animations/{name}" for name in animations]
    for link in links.all():
        link.scroll_into_view_if_needed()
        still = link.locator("img")
        opened.wait_for_function("image => image.complete", arg=still.element_handle())
        assert still.evaluate("image => image.naturalWidth") == 640
        assert still.bounding_box()["width"] >= 250
        assert len(still.get_attribute("alt")) > 40
        assert "play" in link.inner_text()
        animation = opened.request.get(f"{address.rpartition('/')[0]}/{link.get_attribute('href')}").body()
        assert animation[:4] + animation[8:12] == b"RIFFWEBP"
        assert b"ANIM" in animation[:64]


def test_verif_no_text_of_a_figure_is_cut_off(opened):
    cut = opened.evaluate(
        """() => [...document.querySelectorAll('figure svg')].flatMap(svg => {
            const frame = svg.getBoundingClientRect();
            return [...svg.querySelectorAll('text')].filter(text => {
                const box = text.getBoundingClientRect();
                return box.width > 0 && (box.left < frame.left - 1 || box.right > frame.right + 1
                    || box.top < frame.top - 1 || box.bottom > frame.bottom + 1);
            }).map(text => `${svg.getAttribute('aria-label')}: ${text.textContent.trim()}`);
        })"""
    )
    assert cut == []


def test_verif_no_two_texts_of_a_figure_overlap(opened):
    overlapping = opened.evaluate(
        """() => [...document.querySelectorAll('figure svg')].flatMap(svg => {
            const texts = [...svg.querySelectorAll('text')].filter(text => text.textContent.trim())
                .map(text => [text.textContent.trim(), text.getBoundingClientRect()]);
            const margin = 1;
            return texts.flatMap(([a, p], i) => texts.slice(i + 1)
                .filter(([, q]) => p.left < q.right - margin && q.left < p.right - margin
                    && p.top + p.height / 4 < q.bottom - q.height / 4 && q.top + q.height / 4 < p.bottom - p.height / 4)
                .map(([b]) => `${svg.getAttribute('aria-label')}: ${a} | ${b}`));
        })"""
    )
    assert overlapping == []


def replay_part(page, name):
    return page.locator(f"#replay [data-part={name}]")


def test_verif_the_replay_follows_its_slider(opened):
    cursor = replay_part(opened, "error").locator(".cursor")
    wire = replay_part(opened, "overview").locator(".wire")
    slider = replay_part(opened, "time")
    before = [cursor.get_attribute("x1"), wire.get_attribute("d"), replay_part(opened, "now").inner_text()]
    slider.focus()
    for _ in range(5):
        slider.press("ArrowRight")
    after = [cursor.get_attribute("x1"), wire.get_attribute("d"), replay_part(opened, "now").inner_text()]
    assert float(after[0]) > float(before[0])
    assert after[1] != before[1]
    assert float(after[2].split(" s")[0]) > float(before[2].split(" s")[0])
    assert slider.get_attribute("aria-valuetext") == after[2]
    slider.press("Home")
    assert float(cursor.get_attribute("x1")) < float(before[0])
    slider.press("End")
    assert slider.input_value() == slider.get_attribute("max")
    assert opened.console_lines == []


def test_verif_the_replay_plays_and_pauses_and_ends(opened):
    button, slider = replay_part(opened, "play"), replay_part(opened, "time")
    slider.focus()
    slider.press("Home")
    button.focus()
    button.press("Space")
    assert button.inner_text() == "Pause"
    opened.wait_for_function("document.querySelector('#replay [data-part=time]').value > 3")
    button.press("Space")
    assert button.inner_text() == "Play"
    stopped = slider.input_value()
    opened.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    assert slider.input_value() == stopped
    slider.press("End")
    slider.press("ArrowLeft")
    button.click()
    opened.wait_for_function("document.querySelector('#replay [data-part=play]').textContent === 'Play'")
    assert slider.input_value() == slider.get_attribute("max")
    assert opened.console_lines == []


def sets_and_estimators(run):
    """Sets that have a replay, and names of the estimators, of a run in the plane or in space."""
    in_plane = run / "run.json"
    if in_plane.is_file():
        described = json.loads(in_plane.read_text())
        return described["sets"], [estimator["name"] for estimator in described["estimators"]]
    described = json.loads((run / "space_run.json").read_text())
    with (run / "space_summary.csv").open(newline="") as table:
        scored = {(row["group"], row["whisker"]) for row in csv.DictReader(table) if row["rmse_m"]}
    return sorted(scored), list(described["estimators"])


def test_verif_the_replay_shows_every_trial_and_estimator(opened, report):
    sets, names = sets_and_estimators(report.parent)
    trials, estimators = replay_part(opened, "trial"), replay_part(opened, "estimator")
    assert trials.locator("option").count() == len(sets)
    overview = replay_part(opened, "overview")
    most = 0
    for trial in range(len(sets)):
        trials.select_option(index=trial)
        assert estimators.locator("option").count() >= 1
        for estimator in range(estimators.locator("option").count()):
            estimators.select_option(index=estimator)
            for view in ("overview", "closeup"):
                shown = replay_part(opened, view)
                assert shown.locator(".base").count() == 1
                assert "NaN" not in shown.inner_html()
            assert "NaN" not in replay_part(opened, "error").inner_html()
            assert " s" in replay_part(opened, "now").inner_text()
            most = max(most, overview.locator(".truth, .wire, .estimate, .found").count())
    assert most == 4
    trials.select_option(index=0)
    estimators.select_option(index=0)
    if "recommended" in names:
        assert estimators.input_value() == "recommended"
    wide = replay_part(opened, "closeup").get_attribute("viewBox").split()[2]
    replay_part(opened, "zoom").select_option("1")
    assert float(replay_part(opened, "closeup").get_attribute("viewBox").split()[2]) < float(wide)
    for name in ("overview", "closeup", "error", "play", "time", "now"):
        box = replay_part(opened, name).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= opened.viewport_size["width"]
    assert opened.console_lines == []


def test_verif_the_replay_is_a_slide_show_with_reduced_motion(browser, address):
    page = browser.new_page(reduced_motion="reduce")
    page.goto(address)
    replay_part(page, "play").click()
    before = int(replay_part(page, "time").input_value())
    page.wait_for_function("before => document.querySelector('#replay [data-part=time]').value > before", arg=before)
    assert (int(replay_part(page, "time").input_value()) - before) % 5 == 0
    page.close()


def test_verif_the_page_fits_its_window(opened):
    width, window = opened.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
    assert width <= window


def test_verif_the_embedded_font_is_used(opened):
    loaded = opened.evaluate("[...document.fonts].filter(face => face.status === 'loaded').map(face => face.family)")
    assert "Inter" in loaded


def test_verif_the_summary_has_marked_best_values_and_the_footer_its_watermark(opened):
    summary = opened.locator("section#summary table")
    assert summary.locator("tbody tr").count() >= 2
    assert summary.locator("b.best").count() >= 1
    watermark = opened.locator("footer#provenance").inner_text()
    assert re.search(r"\b[0-9a-f]{64}\b", watermark)
    for word in ("written by", "commit", "measurement noise", "seeds"):
        assert word in watermark


def test_verif_linked_files_exist(opened, address):
    links = opened.evaluate("[...document.querySelectorAll('a')].map(link => link.href).filter(href => !href.includes('#'))")
    assert len(links) >= 4
    for link in links:
        assert opened.request.get(link).ok, link


def test_verif_stand_alone_figures_embed_their_font(browser, address):
    page = browser.new_page()
    page.goto(address)
    links = page.evaluate("[...document.querySelectorAll('figcaption a')].map(link => link.href)")
    drawings = [link for link in links if link.endswith(".svg")]
    assert drawings
    for link in drawings:
        page.goto(link)
        assert "font/woff2;base64" in page.content(), link
        assert page.locator("text").count() > 0, link
    page.close()
