"""The page of a result file: what it holds, how large it is, and in a browser what its controls do."""

import base64
import csv
import json
import re
from xml.etree import ElementTree

import browser
import h5py
import numpy as np
import pytest
from conftest import random_coefficients, single, write_sweep
from synthetic import box, write_results
from test_curve import curve_file

from nhbm_post import Results
from nhbm_post.cli import main
from nhbm_post.page import page_data, write_page
from nhbm_post.report import info

in_browser = pytest.mark.skipif(browser.PROGRAM is None, reason="there is no chromium on the path")


def data_of(page):
    text = re.search(r'<script type="application/json" id="data">(.*?)</script>', page.read_text(encoding="utf-8"), re.DOTALL)[1]
    data = json.loads(text)
    columns = data["points"]
    data["points"] = [
        {
            "number": number,
            "kind": columns["kind"][i],
            **{name: columns[name]["words"][columns[name]["at"][i]] for name in ("status", "message")},
            "rows": [[label, texts[i]] for label, texts in columns["rows"] if texts[i] is not None],
        }
        for i, number in enumerate(columns["number"])
    ]
    return data


def coefficients_of(data):
    raw = np.frombuffer(base64.b64decode(data["coefficients"]), "<f4")
    return raw.reshape(-1, len(data["dofs"]) + len(data["forces"]), len(data["tuples"]), 2)


def test_page_holds_the_motions(tmp_path, sweep, capsys):
    assert main(["report", str(sweep)]) == 0
    page = tmp_path / "sweep.html"
    assert capsys.readouterr().out.splitlines()[-1] == f"wrote {page}"
    data = data_of(page)
    assert [point["status"] for point in data["points"]] == ["converged"] * 3 + ["stalled", "failed", "pending"]
    assert data["rows"] == [0, 1, 2, -1, -1, -1] and data["points"][4]["message"] == "dgetrf: singular matrix"
    assert (data["axis"]["label"], data["axis"]["units"]) == ("Gap of law 1 g", "m")
    values = coefficients_of(data)
    with Results(sweep) as results:
        for d, dof in enumerate(dof["name"] for dof in data["dofs"]):
            series = results.series(1, dof)
            for h, j in enumerate(data["tuples"]):
                assert values[1, d, h] == pytest.approx(series.harmonic(j), rel=1e-6)
            assert data["dofs"][d]["size"][1] == pytest.approx(series.peak(), rel=1e-6)
            assert data["dofs"][d]["size"][3] is None
        assert ["law(1)%gap", "1.5e-3 m"] in data["points"][1]["rows"]
    assert "http" not in re.sub(r"http://www.w3.org/2000/svg", "", page.read_text(encoding="utf-8"))


def test_a_page_of_more_points_reads_no_more_often(tmp_path, monkeypatch):
    """Whole columns are read: 40,000 points take seconds."""
    tuples, n_reads, read = box(1, 3), [], h5py.Dataset.__getitem__
    monkeypatch.setattr(h5py.Dataset, "__getitem__", lambda *arguments: (n_reads.append(1), read(*arguments))[1])
    counts = []
    for n in (20, 60):
        omega = np.linspace(1.0, 2.0, n)
        parameters = {"tones_frequency": ("tones%frequency", "rad/s", omega)}
        path = write_results(
            tmp_path / f"{n}.h5", tuples, omega[:, None], random_coefficients(5, n, 1, tuples), parameters=parameters
        )
        n_reads.clear()
        with Results(path) as results:
            page_data(results)
        counts.append(len(n_reads))
    assert counts[0] == counts[1] < 60


def test_harmonics_that_are_nothing_are_left_out(tmp_path):
    tuples = box(1, 5)
    coefficients = np.zeros((1, 1, len(tuples), 2))
    coefficients[0, 0, tuples[:, 0] == 1, 0] = 1.0
    coefficients[0, 0, tuples[:, 0] == 3, 1] = 1e-3
    coefficients[0, 0, tuples[:, 0] == 5, 1] = 1e-9
    with Results(write_results(tmp_path / "a.h5", tuples, [[2.0]], coefficients)) as results:
        data, _ = page_data(results)
    assert sorted(map(tuple, data["tuples"])) == [(1,), (3,)]
    assert data["curves"] == [] and data["axis"] is None


def test_page_stays_below_its_limit(tmp_path, monkeypatch):
    """20 degrees of freedom of 80 points of 25 harmonics are too many for a page: it holds a part and reports this."""
    monkeypatch.setattr("nhbm_post.page._COEFFICIENTS", 30_000)
    monkeypatch.setattr("nhbm_post.page.LARGEST", 500_000)
    tuples = box(2, 3)
    coefficients = random_coefficients(5, 80, 20, tuples) * 10.0 ** np.abs(tuples).sum(axis=1)[:, None]
    dofs = tuple(f"x{k}" for k in range(1, 21))
    frequency = np.column_stack([np.linspace(1.0, 2.0, 80), np.full(80, np.pi)])
    parameters = {"tones_frequency_1": ("tones%frequency(1)", "rad/s", frequency[:, 0])}
    path = write_results(
        tmp_path / "a.h5", tuples, frequency, coefficients, dofs=dofs, law_dofs=("x3",), parameters=parameters
    )
    with Results(path) as results:
        notes = write_page(results, tmp_path / "a.html")
    assert 300_000 < (tmp_path / "a.html").stat().st_size < 500_000
    assert "15 of 20 degrees of freedom are in this page" in notes
    assert data_of(tmp_path / "a.html")["dofs"][0]["name"] == "x3"


def test_page_of_many_points_is_thinned_by_a_rule_that_it_states(tmp_path, monkeypatch):
    """Folds and both ends stay, the others are spread evenly; stability and jumps are those of what lies between."""
    path = curve_file(tmp_path / "a.h5")
    with Results(path) as results:
        n = results.used.size
        whole, _ = page_data(results)
        monkeypatch.setattr("nhbm_post.page._POINTS", n - 2)
        data, notes = page_data(results)
        kinds = results.curve_kind()
    shown = data["points"]["number"]
    assert notes[0] == f"{len(shown)} of {n} points are in this page, evenly over the file, located points first"
    assert len(shown) < n and shown == sorted(shown) and {0, n - 1} <= set(shown)
    located = [point for point in range(n) if kinds[point] not in ("regular", "none", "start", "end", "value")]
    assert located and set(located) <= set(shown)
    for curve, before in zip(data["curves"], whole["curves"]):
        numbers, all_numbers = ([d["points"]["number"][i] for i in c["points"]] for d, c in ((data, curve), (whole, before)))
        for between, a, b in zip(curve["between"], numbers, numbers[1:]):
            i, j = all_numbers.index(a), all_numbers.index(b)
            assert between == min(before["between"][i:j])


def test_page_says_why_curves_ended(tmp_path):
    path = curve_file(tmp_path / "a.h5", n_curves=2)
    with h5py.File(path, "r+") as file:
        n = file["status"].size
        file["reason"] = np.zeros(n, np.int32)
        file["reason"][[6, n - 3]] = 6, 8
        file["message"][6] = np.array([b"the step became too short"], "S400").view("S1")
    with Results(path) as results:
        data, _ = page_data(results)
        described = info(results)
    wanted = ["a curve ended at point 6: the step became too short",
              f"a curve ended at point {n - 3}: it has reached the limit of its points, and continues"]  # fmt: skip
    assert data["notes"][:2] == wanted and all(text in described for text in wanted)


def test_page_of_any_size_is_halved_until_it_fits(tmp_path, monkeypatch):
    monkeypatch.setattr("nhbm_post.page.LARGEST", 60_000)
    path = single(tmp_path / "a.h5", 1, input_groups="! " + 100_000 * "x" + "\n")
    with Results(path) as results:
        write_page(results, tmp_path / "a.html")
    assert (tmp_path / "a.html").stat().st_size <= 60_000
    assert data_of(tmp_path / "a.html")["input"].endswith("more characters, in the result file")


def test_text_of_the_input_ends_no_script(tmp_path):
    path = single(tmp_path / "a.h5", 1, input_groups="! </script><b>\n", title="1 < 2 & </title>")
    with Results(path) as results:
        write_page(results, tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert text.count("</script>") == 2 and data_of(tmp_path / "a.html")["input"].startswith("! </script><b>")
    assert "<title>1 &lt; 2 &amp; &lt;/title></title>" in text


def test_no_text_begins_a_comment_or_a_script(tmp_path):
    """`<!--<script` puts a parser of HTML into a state in which </script> does not end the data."""
    path = single(tmp_path / "a.h5", 1, input_groups="! <!--<script> __DATA__ __TITLE__\n", title="<!--<script> __DATA__")
    with Results(path) as results:
        write_page(results, tmp_path / "a.html")
    data = re.search(r'id="data">(.*?)</script>', (tmp_path / "a.html").read_text(encoding="utf-8"), re.DOTALL)[1]
    assert "<" not in data
    assert json.loads(data)["title"] == "<!--<script> __DATA__"
    assert json.loads(data)["input"].startswith("! <!--<script> __DATA__ __TITLE__")


def test_a_page_needs_a_solved_point(tmp_path, capsys):
    path = write_sweep(tmp_path / "a.h5")
    with h5py.File(path, "a") as file:
        file["status"][...] = 2
    assert main(["report", str(path)]) == 2 and "no point is solved" in capsys.readouterr().err


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    with browser.Browser(tmp_path_factory.mktemp("profile")) as page:
        yield page


def opened(chromium, path, width=1200):
    with Results(path) as results:
        write_page(results, path.with_suffix(".html"))
    chromium.errors.clear()
    chromium.open(path.with_suffix(".html"), width)
    return data_of(path.with_suffix(".html"))


@in_browser
def test_a_click_shows_the_point(tmp_path, chromium):
    data = opened(chromium, curve_file(tmp_path / "a.h5"))
    marks = "[...document.querySelectorAll('#response .event')]"
    kinds = [point["kind"] for point in data["points"] if point["kind"]]
    assert sorted(chromium.run(f"{marks}.map(e => e.dataset.kind)")) == sorted(kinds)
    for n, kind in enumerate(chromium.run(f"{marks}.map(e => e.dataset.kind)")):
        box = chromium.run(f"(b => [b.x + b.width / 2, b.y + b.height / 2])({marks}[{n}].getBoundingClientRect())")
        chromium.click(*box)
        number = chromium.run("state.point")
        assert data["points"][number]["kind"] == kind
        assert chromium.run("document.getElementById('chosen').textContent").startswith(f"Point {number} (")
        assert chromium.run("document.getElementById('error_estimate').rows.length") >= 3
    dashes = set(chromium.run("[...document.querySelectorAll('#response .curve')].map(e => e.getAttribute('stroke-dasharray'))"))
    assert "7 4" in dashes and "" in dashes
    n_jumps = sum(len(curve["falls"]) for curve in data["curves"])
    assert n_jumps > 0 and chromium.run("document.querySelectorAll('#response .jump').length") == n_jumps
    assert not chromium.errors


@in_browser
def test_values_are_shown_under_the_mouse(tmp_path, chromium):
    path = curve_file(tmp_path / "curve.h5")
    assert main(["report", str(path)]) == 0
    chromium.open(tmp_path / "curve.html")
    place = "document.querySelector('#response svg').getBoundingClientRect()"
    left, top = chromium.run(f"{place}.left"), chromium.run(f"{place}.top")
    x, y, point = chromium.run("positions[2]")
    assert chromium.run("document.querySelectorAll('#hint text').length") == 0
    chromium.hover(left + x + 2, top + y + 1)
    words = chromium.run("[...document.querySelectorAll('#hint text')].map(e => e.textContent)")
    assert words[0].startswith(f"point {chromium.run(f'D.points[{point}].number')}") and len(words) == 3 and ":" in words[1]
    chromium.hover(2, 2)
    assert chromium.run("document.querySelectorAll('#hint text').length") == 0
    assert not chromium.errors


@in_browser
def test_forces_of_laws_are_drawn_over_the_motion(tmp_path, chromium):
    """Where the file has forces, the choice over a degree of freedom offers them, with the coefficients of the file."""
    path = curve_file(tmp_path / "curve.h5")
    with h5py.File(path, "r+") as file:
        if "force_coefficients" not in file:
            file["force_coefficients"] = 2.0 * file["coefficients"][:, : file["law_dof"].size]
            file["force_coefficients"].attrs["units"] = "N"
        forces = file["force_coefficients"][:]
    data = opened(chromium, path)
    with Results(path) as results:
        assert [force["name"] for force in data["forces"]] == [f"Force of laws at {dof}" for dof in results.law_dofs]
    values, row = coefficients_of(data), data["rows"].index(0)
    assert np.nanmax(np.abs(values[row, len(data["dofs"]) :])) == pytest.approx(np.abs(forces[row]).max(), rel=1e-6)
    chromium.run("$('other').value = D.dofs.length; $('other').dispatchEvent(new Event('change'))")
    assert chromium.run("$('orbit-title').textContent").startswith("Force of laws at ")
    assert chromium.run("document.querySelectorAll('#orbit .orbit').length") == 1 and not chromium.errors


@in_browser
def test_units_and_colours_suit_each_other(tmp_path, chromium):
    """Hertz are shown as given, a velocity with the prefix of its displacement; many curves have a colour each."""
    path = curve_file(tmp_path / "curve.h5")
    assert main(["report", str(path)]) == 0
    chromium.open(tmp_path / "curve.html")
    assert chromium.run("[600, 9e3, 2e4].map(v => scaled(v, 'Hz')[1])") == ["Hz", "Hz", "kHz"]
    assert chromium.run("range([16, 16.4], true)") == [0, pytest.approx(16.4 * 1.05)]  # a flat curve below the frame
    assert chromium.run("[scaled(0.42, 'm/s')[1], scaled(0.42, 'm/s', 1)[1], scaled(4e-6, 'm/s', 1)[1]]") == ["mm/s", "m/s", "µm/s"]
    assert len(set(chromium.run("Array.from({length: 14}, (_, k) => colourOf(k, 14))"))) == 14
    assert chromium.run("[0, 6].map(k => colourOf(k, 7))") == ["#0072B2", "#000000"]


@in_browser
def test_controls_have_their_effect(tmp_path, chromium):
    data = opened(chromium, write_sweep(tmp_path / "a.h5"))
    text = "document.getElementById('{}').textContent".format
    change = "(e => {{ e.value = '{}'; e.dispatchEvent(new Event('change')); }})(document.getElementById('{}'))".format
    chromium.run("document.getElementById('next').click()")
    assert chromium.run("state.point") == 1
    chromium.run("document.querySelector('#response svg').focus()")
    chromium.press("ArrowRight")
    assert chromium.run("[state.point, document.getElementById('number').value]") == [2, "2"]
    chromium.press("ArrowLeft")
    chromium.run(change("1", "dof"))
    assert data["dofs"][1]["name"] in chromium.run(text("spectrum")) and data["dofs"][1]["name"] in chromium.run(text("time"))
    chromium.run(change("0", "other"))
    assert chromium.run(text("orbit-title")) == f"Orbit: {data['dofs'][0]['name']} over {data['dofs'][1]['name']}"
    # the motion is that of the file
    with Results(tmp_path / "a.h5") as results:
        expected = results.evaluate(1, data["dofs"][1]["name"], 0.7)
    assert chromium.run("value(harmonics(1, 1), 0.7)") == pytest.approx(expected, rel=1e-5)
    assert chromium.run("document.querySelectorAll('#orbit .section').length") == 240
    chromium.run("document.getElementById('logarithmic').click()")
    assert chromium.run("state.logarithmic") is True
    chromium.run(change("4", "number"))
    assert "no motion" in chromium.run(text("time")) and "singular matrix" in chromium.run(text("error_estimate"))
    chromium.run(change("99", "number"))
    assert chromium.run("document.getElementById('number').value") == "4"
    # the shape moves, and stops
    chromium.run(change("0", "number"))
    before = chromium.run("state.phase")
    chromium.wait(f"state.phase !== {before}")
    chromium.run("document.getElementById('play').click()")
    assert chromium.run("new Promise(done => { const p = state.phase; setTimeout(() => done(state.phase === p), 150); })")
    drawn = "[...document.getElementById('shape').getContext('2d').getImageData(0, 0, 300, 200).data].some(v => v > 0)"
    assert chromium.run(drawn)
    assert not chromium.errors


def write_grid(path):
    """Three gaps by six frequencies."""
    tuples = box(1, 3)
    return write_results(
        path,
        tuples,
        np.tile(np.linspace(1.0, 2.0, 6), 3)[:, None],
        random_coefficients(7, 18, 1, tuples),
        parameters={
            "law_1_gap": ("law(1)%gap", "m", np.repeat([0.1, 0.2, 0.3], 6)),
            "tones_frequency": ("tones%frequency", "rad/s", np.tile(np.linspace(1.0, 2.0, 6), 3)),
        },
    )


@in_browser
def test_a_slider_chooses_the_curve(tmp_path, chromium):
    """The motion follows to the nearest point of the next curve; the others are drawn pale; -1 shows all."""
    data = opened(chromium, write_grid(tmp_path / "grid.h5"))
    assert len(data["curves"]) == 3 and chromium.run("getComputedStyle($('slider-controls')).display") == "flex"
    slide = "(e => {{ e.value = {}; e.dispatchEvent(new Event('input')); }})($('curve'))".format
    colours = "[...new Set([...document.querySelectorAll('#response .curve')].map(e => e.getAttribute('stroke')))].length"
    x = chromium.run("select(D.curves[0].points[2]), D.curves[0].x[2]")
    for k, curve in enumerate(data["curves"]):
        chromium.run(slide(k + 1))
        assert curve["x"][curve["points"].index(chromium.run("state.point"))] == x
        assert chromium.run("$('curve-label').textContent") == curve["label"]
        assert chromium.run(colours) == 2
    chromium.run(slide(0))
    assert chromium.run(colours) == 3
    assert not chromium.errors


@in_browser
def test_charts_are_saved(tmp_path, chromium):
    """The picture is a drawing of its own, with its legend; the table has the numbers of the chart."""
    data = opened(chromium, write_grid(tmp_path / "grid.h5"))
    chromium.run("window.saved = {}, window.download = (name, content) => { saved[name] = content; }, 0")
    for kind in ("SVG", "PNG", "CSV"):
        chromium.run(f"document.querySelector('#response [aria-label=\"save response as {kind}\"]').click()")
    chromium.wait("Object.keys(saved).length === 3")
    assert sorted(chromium.run("Object.keys(saved)")) == [f"grid_response.{kind}" for kind in ("csv", "png", "svg")]
    drawing = ElementTree.fromstring(chromium.run("saved['grid_response.svg'].text()"))
    words = [element.text for element in drawing.iter() if element.text]
    assert all(curve["label"] in words for curve in data["curves"])
    assert chromium.run("createImageBitmap(saved['grid_response.png']).then(b => b.width)") >= 1000
    head, *rows = csv.reader(chromium.run("saved['grid_response.csv'].text()").splitlines())
    assert len(rows) == sum(len(curve["points"]) for curve in data["curves"]) and head[1] == "point"
    sizes = {data["points"][i]["number"]: data["dofs"][0]["size"][i] for curve in data["curves"] for i in curve["points"]}
    assert all(float(row[3]) == sizes[int(row[1])] for row in rows)
    for box_of in ("spectrum", "time", "orbit"):
        head, *rows = chromium.run(f"$('{box_of}').table()")
        assert len(rows) > 1 and all(len(row) == len(head) for row in rows)
    assert not chromium.errors


@in_browser
@pytest.mark.parametrize("width", [390, 1200])
def test_page_fits_its_window_and_paper(tmp_path, chromium, width):
    opened(chromium, curve_file(tmp_path / "a.h5"), width)
    chromium.screenshot(tmp_path / "page.png")
    assert chromium.run("document.documentElement.scrollWidth") <= width
    small = chromium.run("Math.min(...[...document.querySelectorAll('text')].map(t => parseFloat(getComputedStyle(t).fontSize)))")
    assert small >= 11
    assert chromium.run("[...document.querySelectorAll('button, select')].every(b => b.getBoundingClientRect().height >= 32)")
    chromium.size(800 - width // 4, 700)
    chromium.wait("document.querySelector('#response svg').viewBox.baseVal.width <= document.documentElement.clientWidth")
    paper = chromium.pdf()  # the curves and the charts of the point on the first page, tables and input on the second
    assert paper.count(b"/Type /Page\n") == 2 and b"/MediaBox [0 0 594.95996 841.91998]" in paper
    chromium.run("window.dispatchEvent(new Event('beforeprint'))")  # charts are drawn anew for paper
    assert chromium.run("document.querySelector('#response svg').viewBox.baseVal.width") <= 700
    chromium.run("window.dispatchEvent(new Event('afterprint'))")
    assert chromium.run("document.querySelector('details').open") is True
    chromium.call("Emulation.setEmulatedMedia", media="print")
    shown = "[...document.querySelectorAll('{}')].filter(e => e.getClientRects().length).length".format
    assert [chromium.run(shown(what)) for what in (".controls", ".hint", "button, select, input")] == [0, 0, 0]
    colours = chromium.run("[...document.querySelectorAll('body *')].map(e => getComputedStyle(e).backgroundColor)")
    assert set(colours) <= {"rgba(0, 0, 0, 0)", "rgb(255, 255, 255)"}
    assert chromium.run("getComputedStyle(document.getElementById('shape')).objectFit") == "contain"  # paper is not as wide
    chromium.call("Emulation.setEmulatedMedia", media="")
    assert not chromium.errors


@in_browser
def test_curves_are_looked_at_closer(tmp_path, chromium):
    """By buttons around the point, by a frame of the mouse; a click within the part chooses a point, and the whole comes back."""
    opened(chromium, curve_file(tmp_path / "a.h5"))
    click = "document.getElementById('{}').click()".format
    whole = chromium.run("view.shown")
    before = chromium.run("[ring.getAttribute('cx'), ring.getAttribute('cy')].map(Number)")
    chromium.run(click("closer"))
    half = chromium.run("view.shown")
    for k in (0, 2):
        assert half[k + 1] - half[k] == pytest.approx(0.5 * (whole[k + 1] - whole[k]))
    assert chromium.run("[ring.getAttribute('cx'), ring.getAttribute('cy')].map(Number)") == pytest.approx(before)
    chromium.run(click("wider"))
    assert chromium.run("view.shown") == pytest.approx(whole)
    svg = "document.querySelector('#response svg').getBoundingClientRect()"
    left, top, width = chromium.run(f"(b => [b.x, b.y, b.width])({svg})")
    start, end = (left + 0.4 * width, top + 60.0), (left + 0.7 * width, top + 200.0)
    chromium.drag(*start, *end)
    shown = chromium.run("view.shown")
    share = (np.array([0.4, 0.7]) * width - 62) / (width - 72)
    assert shown[:2] == pytest.approx(list(whole[0] + share * (whole[1] - whole[0])), rel=1e-3)
    assert chromium.run("document.getElementById('frame')") is None
    position = chromium.run("positions.find(p => p[0] > 100 && p[0] < view.width - 40 && p[1] > 20 && p[1] < view.bottom - 20)")
    if position:
        chromium.click(left + position[0], top + position[1])
        assert chromium.run("state.point") == position[2]
    chromium.run(click("whole"))
    assert chromium.run("view.shown") == whole
    chromium.run(click("logarithmic"))
    chromium.run(click("closer"))
    logarithmic = chromium.run("view.shown")
    assert logarithmic[2] > 0 and chromium.run("view.logs[1]")
    assert not chromium.errors


@in_browser
def test_orbit_of_lengths_has_equal_axes(tmp_path, chromium):
    opened(chromium, write_sweep(tmp_path / "a.h5"))
    chromium.run("(e => { e.value = '1'; e.dispatchEvent(new Event('change')); })(document.getElementById('other'))")
    gaps = chromium.run(
        "[['middle', 'x'], ['end', 'y']].map(([anchor, axis]) => "
        "[...document.querySelectorAll(`#orbit text[text-anchor=${anchor}]`)]"
        ".filter(t => t.textContent && !isNaN(t.textContent)).map(t => [Number(t.textContent), Number(t.getAttribute(axis))]))"
    )
    scale = [abs((pairs[1][1] - pairs[0][1]) / (pairs[1][0] - pairs[0][0])) for pairs in gaps]
    assert scale[0] == pytest.approx(scale[1], rel=1e-3)


@in_browser
def test_errors_of_a_page_are_seen(tmp_path, chromium):
    """The test of the tests: an error in the script does not pass unseen."""
    opened(chromium, single(tmp_path / "a.h5", 1))
    chromium.run("setTimeout(() => missing(), 0)")
    chromium.wait("true")
    chromium.run("new Promise(done => setTimeout(done, 100))")
    assert any("missing is not defined" in error for error in chromium.errors)
