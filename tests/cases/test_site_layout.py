"""The built site (build/site/html, by drivers/site) in Chromium: no page is wider than its window, and the search has excerpts.

A page of its own shows the pages of the site in frames of the widths below and posts what it finds to a server in this process.
"""

from __future__ import annotations

import functools
import http.server
import json
import shutil
import subprocess
import threading
from pathlib import Path

import pytest

SITE = Path(__file__).resolve().parents[2] / "build" / "site" / "html"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
WIDTHS = [390, 1024, 1280, 1366, 1400, 1440]  # [px] of a telephone and of usual screens
SECONDS = 600.0

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not CHROMIUM, reason="Chromium is not here"),
    pytest.mark.skipif(not (SITE / "index.html").is_file(), reason="the site was not built"),
]

HARNESS = """<!doctype html><meta charset="utf-8"><body><script>
"use strict";
const open = (page, width) => new Promise((done) => {
  const frame = document.createElement("iframe");
  frame.style.cssText = `width:${width}px; height:900px; border:0`;
  frame.onload = () => done(frame);
  frame.src = "/" + page;
  document.body.append(frame);
});
const wait = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
const post = (data) => fetch("/found", {method: "POST", body: JSON.stringify(data)});
const tasks = {
  async widths({pages, widths}) {
    const wide = [];
    for (const page of pages) {
      const frame = await open(page, widths[0]);
      for (const width of widths) {
        frame.style.width = `${width}px`;
        await wait(30);
        const root = frame.contentDocument.documentElement;
        if (root.scrollWidth <= width) continue;
        const from = [...root.querySelectorAll("body *")].filter((e) => e.getBoundingClientRect().right > width + 1);
        wide.push(`${page}: ${root.scrollWidth} px at ${width} px, ${from.slice(-1).map((e) => e.outerHTML.slice(0, 120))}`);
      }
      frame.remove();
    }
    return wide;
  },
  async excerpts({words}) {
    const frame = await open(`search.html?q=${words}`, 1280);
    for (let tries = 0; tries < 200; tries++) {
      const found = [...frame.contentDocument.querySelectorAll("#search-results li")];
      if (found.length && found.every((e) => e.querySelector("p"))) break;
      await wait(50);
    }
    return [...frame.contentDocument.querySelectorAll("#search-results li")].map((e) => [
      e.querySelector("a").getAttribute("href"), e.querySelector("p")?.textContent ?? ""]);
  },
};
const task = __TASK__;
tasks[task.name](task).then(post, (error) => post(["error: " + error.stack]));
</script>"""


class Server(http.server.ThreadingHTTPServer):
    """Serves the site and the page of a task, and receives what that finds."""

    def __init__(self, task: dict):
        super().__init__(("127.0.0.1", 0), functools.partial(Handler, directory=str(SITE)))
        self.page = HARNESS.replace("__TASK__", json.dumps(task)).encode()
        self.found, self.is_done = None, threading.Event()


class Handler(http.server.SimpleHTTPRequestHandler):
    def do_GET(self):
        if self.path != "/harness":
            return super().do_GET()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(self.server.page)

    def do_POST(self):
        self.server.found = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(204)
        self.end_headers()
        self.server.is_done.set()

    def log_message(self, *_):
        pass


def found_by(task: dict, folder: Path) -> list:
    with Server(task) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", f"--user-data-dir={folder}"]
        address = f"http://127.0.0.1:{server.server_address[1]}/harness"
        browser = subprocess.Popen([CHROMIUM, *options, "--remote-debugging-port=0", address], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            assert server.is_done.wait(SECONDS), "the browser has not answered"
        finally:
            browser.kill()
            browser.wait()
            server.shutdown()
    return server.found


def test_no_page_is_wider_than_its_window(tmp_path):
    pages = sorted(str(page.relative_to(SITE)) for page in SITE.rglob("*.html") if page.relative_to(SITE).parts[0] not in ("ford", "_static"))
    assert len(pages) > 60
    wide = found_by({"name": "widths", "pages": pages, "widths": WIDTHS}, tmp_path)
    assert not wide, "\n".join(wide)


@pytest.mark.parametrize("words", ["grazing", "natural+frequency", "matlab"])
def test_results_of_the_search_have_excerpts(words, tmp_path):
    found = found_by({"name": "excerpts", "words": words}, tmp_path)
    assert len(found) > 2
    for page, text in found:
        assert len(text) > 40, page
        assert not page.startswith(("docs/why", "docs/develop")), page
    assert any(words.split("+")[0] in text.lower() for _, text in found)
