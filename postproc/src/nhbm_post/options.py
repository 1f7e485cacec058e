"""Options of the command `nhbm-post` that several verbs share, and the conversion of their values."""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path

from .measure import MEASURES
from .reader import QUANTITIES


def add_dof(sub, text="degree of freedom, for example v3 (default: the first on which a law acts)"):
    sub.add_argument("--dof", metavar="LABEL", help=text)


def add_quantity(sub):
    sub.add_argument(
        "--of",
        dest="quantity",
        choices=tuple(QUANTITIES),
        default="motion",
        help="motion (default), force of the laws, motion corrected to the wall, or improved in a wider set",
    )


def add_point(sub, several=False):
    choice = sub.add_mutually_exclusive_group()
    if several:
        choice.add_argument(
            "--point",
            type=numbers,
            metavar="N,N,...",
            help="numbers of the points (default: first converged)",
        )
    else:
        choice.add_argument(
            "--point", type=count(0), metavar="N", help="number of the point (default: first converged)"
        )
    choice.add_argument(
        "--at",
        type=assignment,
        action="append",
        default=[],
        metavar="PARAMETER=VALUE",
        help="point with this value of a swept parameter, for example law(1)%%gap=1.5e-3; may be repeated"
        + ("; all points that fit are drawn" if several else ""),
    )
    sub.add_argument(
        "--unconverged", action="store_true", help="include points that ended without convergence"
    )


def add_where(sub):
    sub.add_argument(
        "--where",
        "--at",
        dest="where",
        type=assignment,
        action="append",
        default=[],
        metavar="PARAMETER=VALUE",
        help="only points with this value of a swept parameter, for example law(1)%%gap=1.5e-3; a list 1e-3,2e-3 and a range "
        "1e-3:2e-3 will do as well; may be repeated",
    )


def add_measure(sub):
    sub.add_argument(
        "--measure",
        choices=MEASURES,
        help="peak: max|x| over hypertime (default); rms; harmonic: amplitude of --tuple; frequency: that of a tone; "
        "multiplier: magnitude of the largest Floquet multiplier",
    )
    sub.add_argument("--tuple", type=tuple_of_integers, metavar="J1,J2,...", help="harmonic to draw, for example 1,0")
    sub.add_argument("--tone", type=count(1), metavar="N", help="number of the tone, from 1 (default: the first unknown one)")


def add_log(sub, letters, more=""):
    sub.add_argument(
        "--log",
        dest="logarithmic",
        type=choice_of_axes(letters),
        metavar="AXES",
        help=f"logarithmic axes: letters of {letters}{more}, or none (default: x{' and y' if 'z' in letters else ''} where the "
        "sweep runs so)",
    )


def axis_label(text):
    letter, mark, words = text.partition("=")
    if letter not in ("x", "y", "z") or not mark:
        raise argparse.ArgumentTypeError(f"'{text}' names no axis; write for example 'x=Excitation frequency f [Hz]'")
    return letter, words


def choice_of_axes(known):
    def convert(text):
        if text != "none" and (not text or set(text) - set(known)):
            raise argparse.ArgumentTypeError(f"'{text}' is not a choice of axes; write letters of {known}, or none")
        return text

    return convert


def pair(text):
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names) or names[0] == names[1]:
        raise argparse.ArgumentTypeError(f"'{text}' is not a pair of parameters; write for example law(1)%gap,load(1)%cos")
    return tuple(names)


def add_window(sub, what):
    sub.add_argument("--from", dest="t_from", type=finite, default=0.0, metavar="T", help=f"start of the {what} [s] (default 0)")
    sub.add_argument("--to", dest="t_to", type=finite, metavar="T", help="its end [s] (default: a slowest period later)")


def add_decades(sub, default=8.0):
    sub.add_argument(
        "--decades",
        type=positive,
        default=default,
        metavar="N",
        help=f"range of the amplitude scale below the largest (default {default:g})",
    )


def add_model(sub):
    sub.add_argument("--model", type=Path, metavar="MODEL", help="model file of the run (default: the one that its input names)")


def add_output(sub):
    sub.add_argument("--output", "-o", type=Path, metavar="PATH", help="picture to write: .png, .pdf, .svg, or .pgf for LaTeX")
    sub.add_argument(
        "--dpi", type=count(20, 2400), default=200, metavar="N", help="dots per inch of a .png (default 200)"
    )
    sub.add_argument("--title", metavar="TEXT", help="heading, in place of the picture's own; '' for none")
    sub.add_argument(
        "--label", dest="labels", type=axis_label, action="append", default=[], metavar="AXIS=TEXT",
        help="words at an axis, such as 'x=Excitation frequency f [Hz]': of x, y, z (or the colours); may be repeated",
    )  # fmt: skip
    sub.add_argument("--width", type=positive, metavar="MM", help="width in millimetres; type keeps its size")
    style = sub.add_argument(
        "--style", action="append", default=[], metavar="NAME",
        help="paper: by default a .pdf of 90 mm, without heading, which is printed for the caption; screen, the default; or a "
        "style file of matplotlib, such as matplotlibrc, with fonts and sizes; may be repeated",
    )  # fmt: skip
    style.examples = ("screen", "paper")  # type: ignore[attr-defined]  # for the completion of shells


def count(least, most=None):
    def convert(text):
        number = int(text)
        if most is not None and number > most:
            raise argparse.ArgumentTypeError(f"{text} is more than {most}")
        if number < least:
            raise argparse.ArgumentTypeError(f"{text} is less than {least}")
        return number

    convert.__name__ = "whole number"
    return convert


def finite(text):
    number = float(text)
    if not math.isfinite(number):
        raise argparse.ArgumentTypeError(f"{text} is not a finite number")
    return number


finite.__name__ = "number"


def positive(text):
    number = float(text)
    if not 0.0 < number < 1000.0:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 1000")
    return number


def numbers(text):
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a list of points; write for example 0,2,5") from None
    return numbers


def tuple_of_integers(text):
    try:
        return tuple(int(part) for part in text.strip("() ").split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a tuple of integers; write for example 1,0 or 2,-1"
        ) from None


def assignment(text):
    name, mark, value = text.partition("=")
    if not (mark and name.strip() and value.strip()):
        raise argparse.ArgumentTypeError(f"'{text}' is no PARAMETER=VALUE; write for example law(1)%gap=1.5e-3")
    return name.strip(), value.strip()


def overlay(text):
    label, mark, path = text.rpartition(":")
    return (label, Path(path)) if mark and label and not Path(text).exists() else ("", Path(text))


def join_negative(words: list[str]) -> list[str]:
    """Joins `--tuple -1,0` to `--tuple=-1,0`, because argparse takes `-1,0` and `-1e-3` for options."""
    joined: list[str] = []
    for word in words:
        is_value = re.match(r"-[.\d]", word) and joined and re.match(r"--[a-z]+$", joined[-1])
        if is_value:
            joined[-1] += "=" + word
        else:
            joined.append(word)
    return joined
