"""Sphinx configuration of the site; drivers/site builds it in build/site/source, with the pages of the repository at the same relative paths."""

import json
import os
import re
import runpy
from pathlib import Path

ROOT = Path(os.environ["NHBM_SOURCE"])
NOTEBOOKS = {f"docs/start/{page.stem}" for page in runpy.run_path(str(ROOT / "docs" / "site" / "notebooks.py"))["tutorials"]()}

project = "nhbm"
author = "The nhbm developers"
release = re.search(r"project\(nhbm VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]
version = release

extensions = ["myst_nb", "sphinx_design", "sphinx_copybutton", "sphinx.ext.mathjax"]
root_doc = "index"
include_patterns = ["index.md", "README.md", "AGENTS.md", "CODE_OF_CONDUCT.md", "CONTRIBUTING.md", "CHANGELOG.md", "SUPPORT.md", "docs/*.md", "docs/**/*.md", "postproc/README.md", "benchmarks/README.md", "gallery/*.md", "reference/**/*.md", "reference/*.md"]

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath", "html_image"]
myst_heading_anchors = 4
nb_execution_mode = os.environ.get("NHBM_SITE_NOTEBOOKS", "force")
nb_execution_in_temp = True
nb_execution_timeout = 600
nb_execution_raise_on_error = True
nb_merge_streams = True
mathjax_path = "mathjax.js"  # of one file, fonts included

html_theme = "furo"
html_title = f"nhbm {release}"
html_static_path = [os.environ["NHBM_SITE_STATIC"]]
html_css_files = ["site.css"]
html_theme_options = {"source_repository": "", "navigation_with_keys": True}
html_show_sourcelink = False
html_show_copyright = False
html_show_search_summary = False  # pages opened from disk may not read each other
copybutton_prompt_text = "$ "
pygments_style = "tango"
suppress_warnings = ["toc.not_included"]  # docs/README.md is for readers of the files
if nb_execution_mode == "off":
    suppress_warnings += ["myst-nb.lexer"]


def add_excerpts(app, pagename, templatename, context, doctree):
    """Scripts of the search page."""
    if pagename == "search":
        app.add_js_file("texts.js")
        app.add_js_file("search.js")


def link_notebook(app, pagename, templatename, context, doctree):
    """Below the title of a tutorial, a link to its notebook (notebooks.py)."""
    if pagename in NOTEBOOKS:
        link = f'<p><a href="../../notebooks/{Path(pagename).name}.ipynb" download>Download this page as a Jupyter notebook</a></p>'
        context["body"] = context["body"].replace("</h1>", f"</h1>\n{link}", 1)


def write_texts(app, exception):
    """The text of each page that the search finds, for its excerpts (search.js)."""
    if exception or app.builder.format != "html":
        return
    names = [name for name in sorted(app.env.found_docs) if "nosearch" not in app.env.metadata[name]]
    texts = {name: re.sub(r"\s+", " ", app.env.get_doctree(name).astext()) for name in names}
    path = Path(app.outdir) / "_static" / "texts.js"
    path.write_text(f"window.NHBM_TEXTS = {json.dumps(texts, ensure_ascii=False)};\n", encoding="utf-8")


def setup(app):
    app.connect("html-page-context", add_excerpts)
    app.connect("html-page-context", link_notebook)
    app.connect("build-finished", write_texts)
