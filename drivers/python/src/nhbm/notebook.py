"""What notebooks show: models and results as tables, the report within a page, orbits, spectra and animations of a motion."""

from __future__ import annotations

import html
import io
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from nhbm import advice
from nhbm.dataset import record_beside, refinement_of, varies_of
from nhbm.errors import ModelError, imported
from nhbm.groups import Groups
from nhbm.located import located_kinds
from nhbm.schema import SOLVED
from nhbm.tables import writing

_LARGEST_FOR_STABILITY = 1000  # degrees of freedom: max_dense of hb_structure
_SAID_ELSEWHERE = ("none", "status", "at_bifurcation")  # reasons without advice: the status, or the kind of the point, has it
_HEIGHT = 900  # of a report in a page [pixels]
_MOST_VALUES = 6  # of a list in a table
_ESTIMATES = {"truncation_estimate": "truncation", "aliasing_estimate": "aliasing"}


def table(rows: Iterable[tuple[str, str]], title: str) -> str:
    """Two columns of texts as HTML."""
    cells = "".join(
        f'<tr><th style="text-align:left">{html.escape(name)}</th><td style="text-align:left">{html.escape(text)}</td></tr>'
        for name, text in rows
    )
    return f"<b>{html.escape(title)}</b><table>{cells}</table>"


def html_of_model(groups: Groups) -> str:
    """The groups of a model with their keys."""
    rows = []
    for group in groups:
        keys = {key: value for key, value in group.keys.items() if key not in ("type", "label")}
        name = " ".join(filter(None, [group.name, str(group.keys.get("type", "")), f"'{group.label}'" if group.label else ""]))
        rows.append((name, ", ".join(f"{key} = {_short(value)}" for key, value in keys.items())))
    return table(rows, "nhbm.Model")


def _short(value: Any) -> str:
    if isinstance(value, tuple):
        words = [_short(one) for one in value[:_MOST_VALUES]]
        return ", ".join([*words, f"... ({len(value)} values)"] if len(value) > _MOST_VALUES else words)
    return str(getattr(value, "input_name", value))


def summary_of(data: xr.Dataset) -> list[tuple[str, str]]:
    """What a result is: its points with their status and stability, what varies, its errors and events."""
    rows = [("motion" if "point" not in data.dims else "points", _counts(data["status"].values))] if "status" in data else []
    if "displacement" in data:
        times = data["time"].values
        rows.append(("record", f"{times[0]:.6g} to {times[-1]:.6g} s, {len(times)} instants"))
    for name in varies_of(data):
        values = data[name].values
        if not values.size:
            continue
        ends = ", ".join(map(str, np.unique(values)))
        if values.dtype.kind in "fi":
            ends = " to ".join(dict.fromkeys(f"{value:.6g}" for value in (values.min(), values.max())))
        unit = str(data[name].attrs.get("units", "1"))
        rows.append((str(data[name].attrs.get("parameter", name)), f"{ends} {'' if unit == '1' else unit}".rstrip()))
    if "stability" in data:
        rows.append(("stability", _counts(data["stability"].values) + (f"; {why}" if (why := why_unknown(data)) else "")))
    if "n_harmonics" in data:
        counts = np.unique(np.ravel(data["n_harmonics"].values))
        if len(counts):
            rows.append(("harmonics", f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"))
    errors = [f"{np.nanmax(data[name].values):.1e} by {word}" for name, word in _ESTIMATES.items()
              if name in data and np.isfinite(data[name].values).any()]  # fmt: skip
    if (by_levels := refinement_of(data)) is not None:
        errors.append(f"{np.nanmax(by_levels):.1e} by refinement")
    if errors:
        rows.append(("largest estimated error", ", ".join(errors)))
    if "curve_kind" in data:
        located = located_kinds(data["curve_kind"].attrs)
        tally = [(np.count_nonzero(data["curve_kind"].values == name), kind) for name, kind in located.items()]
        text = ", ".join(f"{n} {kind.label if n == 1 else kind.plural}" for n, kind in tally if n)
        if text or "point" in data.dims:
            rows.append(("events", text or "none"))
    text = data.nhbm.message if "message" in data else ""
    return [*rows, ("message", text)] if text else rows


def why_unknown(data: xr.Dataset) -> str:
    """Why the stability of motions is not known, and what to do, for each reason."""
    if "stability_reason" not in data:
        return ""
    found = record_beside(data)
    asked = Groups.of_text(found.source.text).first("stability") if found is not None else None
    is_requested = asked is not None and asked.keys.get("method") == "integration"
    words = np.ravel(data["stability_reason"].values)[np.ravel(data["status"].isin(SOLVED).values)]
    texts = []
    for word in dict.fromkeys(words.tolist()):
        if word in _SAID_ELSEWHERE:
            continue
        name = "beyond_limit" if word == "too_costly" and is_requested else word
        texts.append(advice.on(f"stability_{name}", values=[int((words == word).sum()), _LARGEST_FOR_STABILITY]).text)
    return "; ".join(texts)


def _counts(words: Any) -> str:
    if np.ndim(words) == 0:
        return str(words)
    words = np.ravel(words)
    found = {str(word): int((words == word).sum()) for word in dict.fromkeys(words.tolist())}
    return ", ".join(f"{n} {word}" for word, n in found.items())


class Report:
    """The page that `nhbm-post report` writes: the value of a cell of a notebook shows it, `save` writes it."""

    def __init__(self, page: str) -> None:
        self._page = page

    def __repr__(self) -> str:
        return f"<nhbm report: {len(self._page) / 1e6:.1f} MB of HTML; save(path) writes it>"

    def _repr_html_(self) -> str:
        inside = html.escape(self._page, quote=True)
        return f'<iframe srcdoc="{inside}" style="width:100%;height:{_HEIGHT}px;border:0"></iframe>'

    def save(self, path: str | Path) -> None:
        """Writes the page.

        Parameters
        ----------
        path : str or Path
            The file, such as "wall.html".
        """
        if Path(path).suffix.lower() not in (".html", ".htm"):
            raise ModelError(f"a page cannot be written to '{path}': the name must end in .html")
        with writing(Path(path)) as name:
            Path(name).write_text(self._page, encoding="utf-8")


def report(data: xr.Dataset) -> Report:
    """The report of a whole result."""
    page = imported("nhbm_post.page", "reports are made with", "nhbm")
    reader = imported("nhbm_post.reader", "reports are made with", "nhbm")
    errors = imported("nhbm_post.errors", "reports are made with", "nhbm")
    with tempfile.TemporaryDirectory(prefix="nhbm-") as folder:
        path = Path(folder) / "result.h5"
        data.nhbm.save(path)
        try:
            with reader.Results(path) as results:
                page.write_page(results, path.with_suffix(".html"))
        except errors.ReaderError as error:
            raise ModelError(str(error).removeprefix(f"{path}: ")) from None
        return Report(path.with_suffix(".html").read_text(encoding="utf-8"))


class Animation:
    """A moving picture: the value of a cell of a notebook plays it, `save` writes GIF or MP4."""

    def __init__(self, figure: Any, update: Any, n_frames: int, fps: int) -> None:
        self.figure, self._update, self._n_frames, self._fps = figure, update, n_frames, fps

    def _repr_html_(self) -> str:
        animation = imported("matplotlib.animation", "pictures are drawn with")
        imported("matplotlib.backends.backend_agg", "pictures are drawn with").FigureCanvasAgg(self.figure)
        whole = animation.FuncAnimation(self.figure, self._update, self._n_frames, interval=1000 / self._fps, repeat=True)
        return str(whole.to_jshtml(fps=self._fps))

    def save(self, path: str | Path, dpi: int = 100) -> None:
        """Writes the animation.

        Parameters
        ----------
        path : str or Path
            The file, which ends in .gif or .mp4.
        dpi : int
            Pixels per inch.
        """
        imported("nhbm_post.draw", "pictures are drawn with", "matplotlib").save_animation(
            self.figure, self._update, self._n_frames, path, self._fps, dpi
        )


def series_of(data: xr.Dataset, dof: str) -> Any:
    """The harmonics of a degree of freedom of one motion, as nhbm_post has them."""
    if "point" in data.dims:
        raise ModelError("give one motion, such as curve.isel(point=3)")
    series = imported("nhbm_post.series", "pictures are drawn with", "nhbm")
    row, n = data.nhbm._row("coefficients", dof).values, int(data["n_harmonics"])
    tuples = data.nhbm._tuples().values[:n]
    return series.Series(
        tuples, data["frequency"].values, row[:n, 0], row[:n, 1], dof, data.nhbm.unit_of(dof), "displacement"
    ).without_noise(1e-14 * float(np.nanmax(abs(row))))


def drawn(what: str, data: xr.Dataset, dofs: list[str], **options: Any) -> Any:
    """An orbit or a spectrum as a figure that notebooks show."""
    draw = imported("nhbm_post.draw", "pictures are drawn with", "matplotlib")
    all_series = [series_of(data, dof) for dof in dofs]
    if what == "orbit" and len(all_series) == 1:
        all_series.append(all_series[0].velocity())
    return shown(getattr(draw, f"draw_{what}")(*all_series, **options))


def shown(figure: Any) -> Any:
    """The figure, among those of pyplot: notebooks show it at the end of its cell, also behind a semicolon, and scripts by
    `plt.show()`. Later cells show it as their value."""
    plt = imported("matplotlib.pyplot", "pictures are drawn with")
    plt.figure(FigureClass=lambda *_, **__: figure)

    def display() -> None:
        into = io.BytesIO()
        figure.savefig(into, format="png", dpi=100, bbox_inches="tight")
        plt.close(figure)  # otherwise it is shown once more at the end of the cell
        shell = imported("IPython.display", "notebooks are shown with", "ipython")
        shell.display(shell.Image(into.getvalue()))

    figure._ipython_display_ = display
    return figure


def animated(data: xr.Dataset, dof: str, frames: int, fps: int) -> Animation:
    """The motion of a degree of freedom: a period, or six of the slowest of several tones."""
    draw = imported("nhbm_post.draw", "pictures are drawn with", "matplotlib")
    series = series_of(data, dof)
    periods = 1 if series.n_tones == 1 else 6
    times = np.linspace(0.0, 2 * np.pi * periods / float(np.abs(series.omega).min()), frames, endpoint=False)
    figure, update = draw.hypertime_in_motion(series, times, "")
    return Animation(figure, update, frames, fps)
