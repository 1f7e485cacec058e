"""The built site (build/site/html, by drivers/site) in Chromium, from disk: no page is wider than its window, and the search has
excerpts."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "postproc" / "tests"))
import browser  # noqa: E402

SITE = ROOT / "build" / "site" / "html"
WIDTHS = [390, 1024, 1280, 1366, 1400, 1440]  # [px] of a telephone and of usual screens

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(browser.PROGRAM is None, reason="Chromium is not here"),
    pytest.mark.skipif(not (SITE / "index.html").is_file(), reason="the site was not built"),
]
WIDEST = """[...document.querySelectorAll("body *")].filter(e => e.getBoundingClientRect().right > innerWidth + 1).slice(-1)
  .map(e => e.outerHTML.slice(0, 100))[0]"""


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    with browser.Browser(tmp_path_factory.mktemp("profile")) as page:
        yield page


def test_no_page_is_wider_than_its_window(chromium):
    pages = sorted(page for page in SITE.rglob("*.html") if page.relative_to(SITE).parts[0] not in ("ford", "_static"))
    assert len(pages) > 60
    wide = []
    for page in pages:
        chromium.size(WIDTHS[0], 900)
        chromium.load(page.as_uri())
        for width in WIDTHS:
            chromium.size(width, 900)
            found = chromium.run("document.documentElement.scrollWidth")
            if found > width:
                wide.append(f"{page.relative_to(SITE)}: {found} px in a window of {width} px, {chromium.run(WIDEST)}")
    assert not wide, "\n".join(wide)


def test_meanings_of_keys_are_within_their_window(chromium):
    """The last column of a table of keys is its meaning."""
    cut = """[...document.querySelectorAll(".table-wrapper")].filter(e => e.querySelector("th")?.textContent == "key"
      && e.scrollWidth > e.clientWidth + 1).length"""
    wide = []
    for page in sorted([*SITE.glob("docs/user/laws/*.html"), *SITE.glob("docs/user/input/*.html")]):
        chromium.load(page.as_uri())
        for width in WIDTHS:
            chromium.size(width, 900)
            if chromium.run(cut):
                wide.append(f"{page.relative_to(SITE)} in a window of {width} px")
    assert not wide, "\n".join(wide)


@pytest.mark.parametrize("words", ["grazing", "natural frequency", "matlab"])
def test_results_of_the_search_have_excerpts(words, chromium):
    chromium.size(1280, 900)
    found = "[...document.querySelectorAll('#search-results li')]"
    chromium.load(f"{(SITE / 'search.html').as_uri()}?q={words.replace(' ', '+')}",
                  f"{found}.length > 2 && {found}.every(e => e.querySelector('p'))")  # fmt: skip
    results = chromium.run(f"{found}.map(e => [e.querySelector('a').getAttribute('href'), e.querySelector('p').textContent])")
    assert all(len(text) > 40 for _, text in results)
    assert not [page for page, _ in results if page.startswith(("docs/why", "docs/develop"))]
    assert any(words.split()[0] in text.lower() for _, text in results)
    with_all = [text for _, text in results if all(word[:7] in text.lower() for word in words.split())]
    assert len(with_all) >= len(results) / 2, results  # not only the first word that the page has


def test_tutorials_are_offered_as_notebooks(chromium):
    """By a link below the title, to a file of the site."""
    pages = [page for page in (SITE / "docs" / "start").glob("*.html") if (SITE / "notebooks" / f"{page.stem}.ipynb").is_file()]
    assert len(pages) >= 5
    for page in pages:
        chromium.load(page.as_uri())
        found = chromium.run("document.querySelector('a[download]')?.href ?? ''")
        assert found == (SITE / "notebooks" / f"{page.stem}.ipynb").as_uri()
