"""Contacts of a structure: the state of each node of the contact area, as maps over the area and over time."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from ..contact import OPEN, SLIP, STICK, UNITS, Contact, History
from . import style

_COLOURS = {OPEN: "#dfe3e8", STICK: style.COLOURS[0], SLIP: style.COLOURS[1]}
_PANEL = 2.3  # [inch]


def draw_patch(contact: Contact, values: dict[str, np.ndarray], points: np.ndarray | None, about: str):
    """One panel for each of `values` (n_nodes), at the nodes' `points` (n_nodes, 3) projected along the direction in which the
    contact area is thinnest; over the position if it is a line, over the number of the contact if contacts have no nodes."""
    number_label = "Contact" if points is None else ""
    if points is None:
        points = np.outer(np.arange(1.0, contact.n + 1), [1.0, 0.0, 0.0])
    extent = np.ptp(points, axis=0)
    first, second = sorted(np.argsort(-extent, kind="stable")[:2])
    is_line = extent[[first, second]].min() < 1e-3 * max(extent.max(), 1e-300)
    along = int(np.argmax(extent))
    with style.look():
        n_columns = min(len(values), style.max_columns(0.4, 1.3 * _PANEL))
        n_rows = -(-len(values) // n_columns)
        ratio = extent[second] / max(extent[first], 1e-300)
        is_to_scale = 0.2 <= ratio <= 2.0
        ratio = float(np.clip(ratio, 0.25, 1.2)) if is_to_scale and not is_line else 0.8
        fig = style.panels(0.4 + 1.3 * _PANEL * n_columns, 0.6 + n_rows * (0.65 + _PANEL * ratio))
        axes = fig.subplots(n_rows, n_columns, squeeze=False).ravel()
        for ax in axes[len(values) :]:
            ax.set_axis_off()
        for ax, (name, value) in zip(axes, values.items()):
            factor, units = style.unit_scale(float(np.nanmax(np.abs(value))), UNITS[name]) if UNITS[name] != "1" else (1.0, "1")
            if is_line:
                order = np.argsort(points[:, along], kind="stable")
                ax.plot(points[order, along], factor * value[order], "o-", markersize=3.5, color=style.COLOURS[0])
                ax.set(xlabel=number_label or f"{'xyz'[along]} [m]", ylabel=style.with_unit(name.capitalize(), units))
                ax.ticklabel_format(useOffset=False)
                ax.set_ylim(*((-0.02, 1.02) if name.endswith("share") else ax.get_ylim()))
                ax.grid(True)
                continue
            limits = {"vmin": 0.0, "vmax": max(float(value.max()), 0.01)} if name.endswith("share") else {}
            is_zero = not np.nan_to_num(value).any()
            if is_zero:
                limits = {"vmin": 0.0, "vmax": 1.0}
            unit = np.full(2, extent.max()) if is_to_scale else extent[[first, second]]
            drawn = ax.add_collection(_squares(points[:, [first, second]], unit))
            drawn.set(array=factor * value, cmap=style.COLOUR_MAP, edgecolor=style.INK, linewidth=0.3, gid="nodes")
            drawn.set_clim(**limits)
            fig.colorbar(drawn, cax=ax.inset_axes((1.05, 0.0, 0.06, 1.0)), ticks=[0.0] if is_zero else None)
            ax.set_title(style.with_unit(name.capitalize(), units))
            ax.set(xlabel=f"{'xyz'[first]} [m]", ylabel=f"{'xyz'[second]} [m]", aspect="equal" if is_to_scale else "auto")
            for k, set_limits in ((first, ax.set_xlim), (second, ax.set_ylim)):
                margin = 0.12 * extent[along if is_to_scale else k]
                set_limits(points[:, k].min() - margin, points[:, k].max() + margin)
            ax.locator_params(nbins=4)
        style.head(fig, f"Contact '{contact.label}', {contact.kind}, {contact.counted}", about)
    return fig


def _squares(points: np.ndarray, unit: np.ndarray) -> PatchCollection:
    """A square at each node that leaves a gap to the closest one; it is one where lengths of `unit` are drawn alike."""
    away = np.hypot(*((points[:, None] - points[None, :]) / unit).transpose(2, 0, 1))
    away[np.diag_indices(len(points))] = np.inf
    width, height = min(0.12, 0.75 * float(np.median(away.min(axis=1)))) * unit
    return PatchCollection([Rectangle((x - width / 2, y - height / 2), width, height) for x, y in points])


def draw_contact_time(
    contact: Contact, found: History, times: np.ndarray, points: np.ndarray | None, has_axis: bool, about: str
):
    """Open, stick and slip at each node over time, and the forces of all nodes. Nodes are ordered by their position along the
    contact area or their angle about the axis z, contacts without nodes by their numbers."""
    if points is None:
        order, of_rows = np.arange(contact.n), "Contact"
    elif has_axis:
        order, of_rows = np.argsort(np.arctan2(points[:, 1], points[:, 0]), kind="stable"), "Node, in the order of the angle"
    else:
        along = int(np.argmax(np.ptp(points, axis=0)))
        order = np.lexsort((*np.delete(points, along, axis=1).T, np.round(points[:, along], 12)))
        of_rows = f"Node, in the order of {'xyz'[along]}"
    with style.look():
        fig = style.figure(6.6, 5.0)
        closed = "stick" if contact.slides else "closed"
        handles = [Patch(facecolor=_COLOURS[k], label=text) for k, text in ((OPEN, "open"), (STICK, closed), (SLIP, "slip"))
                   if k in found.status]  # fmt: skip
        upper, lower = style.below_legends(fig, [handles], 3.0, 1.2)
        factor, units = style.unit_scale(float(np.ptp(times)), "s")
        colours, norm = ListedColormap(list(_COLOURS.values())), BoundaryNorm([-0.5, 0.5, 1.5, 2.5], 3)
        t = factor * times
        edges = 0.5 + np.arange(len(order) + 1)
        middles = np.concatenate([t[:1], (t[1:] + t[:-1]) / 2, t[-1:]])
        upper.pcolormesh(middles, edges, found.status[:, order].T, cmap=colours, norm=norm, rasterized=True)
        upper.set(xlim=(t[0], t[-1]), ylim=(edges[0], edges[-1]), ylabel=of_rows)
        upper.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        forces = {"normal": found.normal_force, "friction (magnitude)": found.friction}
        forces = {name: np.nansum(f, axis=1) for name, f in forces.items() if np.isfinite(f).any()}
        by, force_units = style.unit_scale(max((float(f.max()) for f in forces.values()), default=0.0), "N")
        for (name, force), colour in zip(forces.items(), style.COLOURS):
            lower.plot(t, by * force, color=colour, label=name)
        lower.set(xlabel=f"Time $t$ [{units}]", ylabel=style.with_unit("Sum of forces", force_units), xlim=(t[0], t[-1]))
        lower.legend(**style.ABOVE)
        lower.grid(True)
        style.head(fig, f"Contact '{contact.label}', {contact.kind}, over time", about)
    return fig
