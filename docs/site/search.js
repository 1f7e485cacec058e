/* Excerpts below the results of the search. Pages opened from disk may not read each other, which is what Sphinx would do: the texts are
   in texts.js, which conf.py writes. */
"use strict";

document.addEventListener("DOMContentLoaded", () => {
  const found = document.getElementById("search-results");
  if (!found || !window.NHBM_TEXTS) return;
  const words = (new URLSearchParams(window.location.search).get("q") || "").toLowerCase().split(/\s+/)
    .filter((word) => word.length > 1).map((word) => word.length > 4 ? word.replace(/(y|ies|s)$/, "") : word); // frequency, frequencies
  const width = 220;

  /* Where most of the words are near each other, the first such place. */
  const place = (text) => {
    let best = [0, -1];
    for (const word of words) {
      for (let at = text.indexOf(word); at >= 0; at = text.indexOf(word, at + 1)) {
        const near = text.slice(at, at + width / 2);
        const n = words.filter((other) => near.includes(other)).length;
        if (n > best[0] || (n === best[0] && at < best[1])) best = [n, at];
        if (n === words.length) break;
      }
    }
    return best[1];
  };

  const excerpt = (text) => {
    const from = Math.max(0, place(text.toLowerCase()) - width / 3);
    const first = from ? text.indexOf(" ", from) + 1 : 0;
    const part = document.createElement("p");
    part.className = "excerpt";
    part.append(first ? "... " : "");
    let rest = text.slice(first, first + width);
    while (rest) {
      const next = words.map((word) => [rest.toLowerCase().indexOf(word), word.length]).filter(([at]) => at >= 0).sort((a, b) => a[0] - b[0])[0];
      if (!next) break;
      const mark = document.createElement("mark");
      mark.textContent = rest.slice(next[0], next[0] + next[1]);
      part.append(rest.slice(0, next[0]), mark);
      rest = rest.slice(next[0] + next[1]);
    }
    part.append(rest, " ...");
    return part;
  };

  const complete = () => {
    for (const link of found.querySelectorAll("li > a:not([data-excerpt])")) {
      link.dataset.excerpt = "";
      const page = new URL(link.href).pathname;
      const name = Object.keys(window.NHBM_TEXTS).find((name) => page.endsWith(`/${name}.html`));
      if (name && !link.parentElement.querySelector("p")) link.parentElement.append(excerpt(window.NHBM_TEXTS[name]));
    }
  };
  new MutationObserver(complete).observe(found, { childList: true, subtree: true });
  complete();
});
