"""Pictures of docs/why/accuracy.md, in the look of nhbm-post."""

from __future__ import annotations

import numpy as np
from against_time import INTEGRATIONS
from matplotlib.lines import Line2D
from nhbm_post.rates import convergence_rate
from nhbm_post.draw import style
from nhbm_post.draw.style import save  # noqa: F401
from times import best_balance, order_of
from tones import SHOWN_ORDERS

INTEGRATED, BALANCED = "#D55E00", "#0072B2"
SHOWN_TIMES = ("cubic_1e10", "wall", "stop_c2a", "jenkins")  # a smooth law, a rigid wall, an elastic stop, friction
LOOKS = {
    "runge_kutta_4": ("#D55E00", "o"),
    "central_differences": ("#E69F00", "s"),
    "generalized_alpha": ("#CC79A7", "D"),
    "cvode": ("#8a5a00", "^"),
    "newton": ("#56B4E9", "v"),
    "broyden": ("#0072B2", "o"),
    "krylov": ("#009E73", "s"),
    "auto": ("#000000", "X"),
    "improved": ("#6A4C93", "P"),
    "tolerance": ("#A00050", "*"),
}
NAMES = {**INTEGRATIONS, "newton": "balance, Newton", "broyden": "balance, Broyden", "krylov": "balance, Krylov",
         "auto": "balance, automatic", "improved": "balance, improved afterwards", "tolerance": "balance by tolerance"}  # fmt: skip


def draw_figure_4(found):
    with style.look():
        fig = style.figure(8.6, 4.9)
        axes = fig.subplots(2, len(found), sharex=True, height_ratios=(3, 2))
        for column, one in enumerate(found):
            _over_time(axes[0, column], one)
            axes[0, column].set_title(f"spring {one.title}")
            _difference(axes[1, column], [one], [INTEGRATED])
        axes[0, -1].legend(**style.ABOVE)
        title = "Figure 4: time integration on top of the balance of order 7"
        style.head(fig, title, "midspan, 20 s after the transient; below: time integration minus balance")
    return fig


def draw_figure_7(found):
    with style.look():
        fig = style.figure(8.0, 5.0)
        axes = fig.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        _over_time(axes[0], found[-1])
        axes[0].axhline(1.5, color=style.WALL, lw=0.9)
        axes[0].text(found[-1].t[-1], 1.56, "wall", ha="right", va="bottom", color=style.MUTED, size=8.5)
        axes[0].legend(**style.ABOVE)
        _difference(axes[1], found[::3], [style.COLOURS[4], INTEGRATED], [one.title for one in found[::3]])
        axes[1].legend(**style.ABOVE)
        title = "Figure 7: the rigid wall, time integration on top of the balance of order 12"
        style.head(fig, title, "midspan, 20 s after the transient; below: time integration minus balance")
    return fig


def _over_time(ax, one):
    ax.plot(one.t, 1e3 * one.balanced, color=BALANCED, lw=2.4, alpha=0.55, label="balance")
    ax.plot(one.t, 1e3 * one.integrated, color=INTEGRATED, lw=0.8, label="integration")
    ax.set_ylabel("Displacement [mm]")
    ax.set_xlim(one.t[0], one.t[-1])


def _difference(ax, found, colours, labels=("",)):
    largest = max(np.abs(one.difference).max() for one in found)
    factor, units = style.unit_scale(largest, "m")
    if largest < 1e-12:
        power = int(np.floor(np.log10(largest)))
        factor, units = 10.0**-power, rf"$10^{{{power}}}$ m"
    for one, colour, label in zip(found, colours, labels):
        ax.plot(one.t, factor * one.difference, color=colour, lw=0.8, label=label)
    ax.set_ylabel(f"Difference [{units}]")
    ax.set_xlabel("Time $t$ [s]")


def draw_coefficients(order, error):
    rate = convergence_rate(order, error, "algebraic")
    with style.look():
        fig = style.figure(5.2, 3.7)
        ax = fig.subplots()
        known = np.isfinite(error)
        ax.loglog(order[known], error[known], "o-", color=BALANCED, label="balance")
        if rate:
            x = order[rate.points]
            ax.loglog(x, rate(x), color=style.MUTED, lw=0.9, ls=style.REFERENCE, label=rate.text("N"))
        ax.set_xticks(order[known], [f"{n:.0f}" for n in order[known]])
        ax.minorticks_off()
        ax.set(xlabel="Order $N$ of the series", ylabel="Relative rms error of eight tuples")
        ax.legend(**style.ABOVE)
        ax.grid(True)
        style.head(fig, "Elastic stop under two tones (C2a)", "against coefficients with 11 digits by integration with events")
    return fig


def draw_times(findings):
    """Error over processor time, one panel a kind of law; the table beside it has all cases."""
    findings = [finding for finding in findings if finding.case.name in SHOWN_TIMES]
    columns = 2
    with style.look():
        fig = style.figure(8.4, 6.6)
        axes = fig.subplots(-(-len(findings) // columns), columns, squeeze=False).ravel()
        seen = []
        for ax, finding in zip(axes, findings):
            for name, points in finding.curves.items():
                seen += [name] if name not in seen else []
                is_integration = name in INTEGRATIONS
                seconds, errors = [p.seconds for p in points], [max(p.error, 1e-14) for p in points]
                ax.loglog(seconds, errors, ms=4.0, lw=1.0 if is_integration else 1.5, **_look(name))
            ax.set_title(finding.case.title, size=9.0)
            ax.grid(True)
            ax.set_ylim(*_range(finding))
        for ax in axes[-columns:]:
            ax.set_xlabel("Processor time [s]")
        for ax in axes[::columns]:
            ax.set_ylabel("Relative rms error")
        order = sorted(seen, key=list(NAMES).index)
        handles = [Line2D([], [], ms=4.5, label=NAMES[name], **_look(name)) for name in order]
        fig.legend(handles=handles, loc="lower center", ncols=4)
        details = "of the displacement at the law over ten periods of the slower tone; "
        details += "time integration from rest through the transient, balance with set-up"
        style.head(fig, "Error over processor time: time integration (hollow) and balance", details)
        left, _, width, height = fig.get_layout_engine().get()["rect"]
        foot = 0.7 / fig.get_size_inches()[1]  # of the legend
        fig.get_layout_engine().set(rect=(left, foot, width, height - foot))
    return fig


def _look(name: str) -> dict:
    colour, marker = LOOKS.get(name, ("#000000", "x"))
    is_integration = name in INTEGRATIONS
    return {"color": colour, "marker": marker, "mfc": "white" if is_integration else colour}


def _range(finding) -> tuple[float, float]:
    """Errors from a little below the least to a little above the largest."""
    errors = [max(p.error, 1e-14) for points in finding.curves.values() for p in points]
    return min(errors) / 4.0, max(errors) * 4.0


def draw_orders(findings):
    """Error over order: smooth laws with a logarithm on one axis, contact and friction on both."""
    with style.look():
        fig = style.figure(9.4, 4.3)
        axes = fig.subplots(1, 2)
        for ax, is_smooth in zip(axes, (True, False)):
            chosen = [finding for finding in findings if finding.case.is_smooth == is_smooth]
            for i, finding in enumerate(chosen):
                _, points = best_balance(finding)
                orders = np.array([order_of(p) for p in points], dtype=float)
                errors = np.array([p.error for p in points])
                rate = convergence_rate(orders, errors)
                label = finding.case.title + (f": {rate.text('N')}" if rate else "")
                look = {"color": style.COLOURS[i], "marker": style.MARKERS[i]}
                ax.plot(orders, np.maximum(errors, 1e-15), ms=4.5, label=label, **look)
            ax.set(xlabel="Order $N$ of the series", yscale="log", xscale="linear" if is_smooth else "log")
            ax.grid(True)
            ax.legend(loc="lower left", fontsize=7.0, bbox_to_anchor=(0.0, 1.06), borderaxespad=0.0)
            ticks = range(1, 23, 2) if is_smooth else (3, 5, 7, 9, 13, 17, 25)
            ax.set_xticks(ticks, [str(n) for n in ticks])
            if not is_smooth:
                ax.minorticks_off()
        axes[0].set_ylabel("Relative rms error")
        style.head(fig, "Error over order: smooth laws (left), contact and friction (right)")
    return fig


def draw_tones(found):
    with style.look():
        fig = style.figure(9.0, 3.9)
        left, right = fig.subplots(1, 2)
        for one, colour in zip(found, (BALANCED, INTEGRATED)):
            n = len(one.t) // 200
            tops = [one.apart[i * n : (i + 1) * n].max() for i in range(200)]
            left.semilogy(one.t[: 200 * n : n], tops, color=colour, lw=1.1, label=one.name)
            label = f"{one.name}: best series of this order"
            right.loglog(SHOWN_ORDERS, one.best, color=colour, lw=1.0, ls=style.REFERENCE, label=label)
            right.loglog(one.orders, one.errors, color=colour, marker="o", ms=4.5, label=f"{one.name}: balance")
        left.set(xlabel="Time $t$ [s]", ylabel="Relative difference", title="two time integrations from different starts")
        right.set(xlabel="Order $N$ of the series", ylabel="Relative rms error", title="what a series of order N can do, and does")
        right.set_xticks(SHOWN_ORDERS[::2], [str(n) for n in SHOWN_ORDERS[::2]])
        right.minorticks_off()
        right.set_ylim(2e-3, 0.6)
        for ax in (left, right):
            ax.grid(True)
            ax.legend(fontsize=7.5, loc="upper left", bbox_to_anchor=(0.0, -0.18))
        style.head(fig, "The beam on a stop: a torus with its two tones, slow to converge")
    return fig
