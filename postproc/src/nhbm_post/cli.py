"""The command `nhbm-post`: pictures, tables and numbers from a result file."""

from __future__ import annotations

import argparse
import errno
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path

from nhbm import shells
from nhbm.arguments import Parser
from nhbm.child_process import is_input

from . import __version__, options, verbs
from .appearance import appearance
from .errors import NhbmPostError, UsageError
from .hdf5 import DAMAGES

_DESCRIPTION = """\
Draws and prints what is in an HDF5 result file of nhbm.

A point of a sweep is chosen by --point NUMBER or by --at PARAMETER=VALUE (path of a swept parameter in
the input, such as law(1)%gap, or its name in the file; values to six digits; repeat it for several
parameters). Without either it is the first converged point. Without --dof it is the first degree of
freedom on which a law acts. Pictures go next to the file and are named after it: beam.h5 gives
beam_spectrum.png; --output chooses another name, and its ending the format (.png, .pdf, .svg or
.pgf).
"""


def main(argv: list[str] | None = None) -> int:
    """Runs one command; returns the exit status: 0, or 2 for an error of the user."""
    parser = _parser()
    arguments = parser.parse_args(options.join_negative(sys.argv[1:] if argv is None else list(argv)))
    if "files" in arguments:
        arguments.file = arguments.files[0][1]
    fonts, is_new = logging.getLogger("matplotlib.font_manager"), _each_once()
    fonts.addFilter(is_new)  # a font that is not installed would be reported for each text
    try:
        looks = vars(arguments)
        if looks.get("output") and is_input(looks["output"], arguments):
            raise UsageError(f"'{looks['output']}' is an input of this command; give another --output")
        styles = looks.get("style") or []
        settings: dict = {}
        for name in styles:
            if name not in ("screen", "paper"):
                settings.update(_settings_of(name))
        with appearance(looks.get("title"), looks.get("width"), "paper" in styles, settings):
            arguments.run(arguments)
        sys.stdout.flush()
    except NhbmPostError as error:
        print(f"nhbm-post {arguments.command}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except Exception as error:
        return _end_of_failed(error, arguments)
    finally:
        fonts.removeFilter(is_new)
    return 0


def _each_once() -> Callable[[logging.LogRecord], bool]:
    """Filter that holds for the first record of each text."""
    seen: set[str] = set()

    def is_new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        known = text in seen
        seen.add(text)
        return not known

    return is_new


def _settings_of(name: str) -> dict:
    """Settings of a style file."""
    from .draw.style import settings_of

    if not Path(name).is_file():
        raise UsageError(f"--style {name}: neither screen, paper nor a style file of matplotlib")
    return settings_of(Path(name))


def _end_of_failed(error: Exception, arguments: argparse.Namespace) -> int:
    """Exit status after an exception, with a line on standard error; what is none of the user is raised again."""
    if isinstance(error, BrokenPipeError):  # the reader of a pipe, for example head, has closed it
        _discard_output()
        return 0
    if type(error).__module__.partition(".")[0] == "kiwisolver" or str(error).startswith("invalid width"):  # of Matplotlib
        text = "the texts do not fit into the picture: a larger --width, or a shorter --title"
        print(f"nhbm-post {arguments.command}: {text}", file=sys.stderr)
        return 2
    if isinstance(error, DAMAGES):
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            _discard_output()
            print(f"nhbm-post {arguments.command}: standard output cannot be written ({error.strerror})", file=sys.stderr)
            return 2
        what = " ".join(f"{type(error).__name__}: {error}".split())
        print(f"nhbm-post {arguments.command}: {arguments.file} cannot be read, it may be damaged ({what})", file=sys.stderr)
        return 2
    raise error


def _discard_output() -> None:
    """Discards the buffered standard output."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="nhbm-post", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"nhbm-post {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)

    def command(name, run, help_text, description, file_help="result file of nhbm (HDF5)", several=False):
        sub = commands.add_parser(name, help=help_text, description=description)
        sub.set_defaults(run=run)
        if several:
            sub.add_argument(
                "files", type=options.overlay, nargs="+", metavar="[LABEL:]FILE", help=file_help + "; several in one picture"
            )
        else:
            sub.add_argument("file", type=Path, metavar="FILE", help=file_help)
        return sub

    sub = command(
        "info",
        verbs.info,
        "print what is in a file",
        "Prints title, version, swept parameters, counts of outcomes, and a row a point: parameters, status, "
        "iterations, residual, seconds and the largest amplitudes (or why the point failed).",
    )
    options.add_dof(sub)
    sub.add_argument(
        "--points", type=options.count(0), default=20, metavar="N", help="rows to print at most (default 20)"
    )

    sub = command(
        "value",
        verbs.value,
        "print one harmonic with all digits",
        "Prints cos, sin and amplitude of one harmonic on one line, with 17 digits each. A mirrored tuple "
        "-j gives (cos, -sin) of the stored one.",
    )
    options.add_dof(sub)
    options.add_quantity(sub)
    options.add_point(sub)
    sub.add_argument(
        "--tuple", type=options.tuple_of_integers, required=True, metavar="J1,J2,...", help="harmonic, for example 1,0 or 2,-1"
    )

    sub = command(
        "correction",
        verbs.correction,
        "correction to the wall, four panels (figure 6 of the paper)",
        "Draws (a) the spectrum of the motion, (b) the motion over hypertime, (c) the same corrected to "
        "the wall, (d) the spectrum of the corrected motion. Uses the surfaces of the file if it has any "
        "(&output samples), else sums the coefficients and reports this in the picture. With three tones or "
        "more the surfaces are the section at tau_3 = ... = 0.",
    )
    options.add_dof(sub, "degree of freedom on which a law acts (default: the first)")
    options.add_point(sub)
    sub.add_argument(
        "--view", choices=("surface", "map"), default="surface", help="3-D surfaces (default) or level maps"
    )
    sub.add_argument(
        "--samples",
        type=options.count(4),
        default=96,
        metavar="N",
        help="samples a tone where surfaces are summed from coefficients (default 96)",
    )
    options.add_decades(sub)
    options.add_output(sub)

    sub = command(
        "time",
        verbs.time,
        "motion over time (figures 4 and 7 of the paper)",
        "Draws a degree of freedom over time, for one or several points of a sweep, over other result "
        "files or over recorded time series. Default window: 2 periods of one tone, 8 of the slowest of several, from t = 0, or "
        "the last ones of an overlaid record. --output NAME.csv writes the numbers in place of a picture. Of a record of nhbm "
        "integrate it draws the motion and its harmonics at the tones.",
    )
    options.add_dof(sub)
    options.add_quantity(sub)
    options.add_point(sub, several=True)
    sub.add_argument("--from", dest="t_from", type=options.finite, metavar="T", help="start of the window [s]")
    sub.add_argument("--to", dest="t_to", type=options.finite, metavar="T", help="end of the window [s]")
    sub.add_argument(
        "--level", type=options.finite, metavar="X", help="draw a wall at this displacement, in the unit of the file"
    )
    sub.add_argument(
        "--overlay",
        type=options.overlay,
        action="append",
        default=[],
        metavar="[LABEL:]PATH",
        help="draw below: a second result file (.h5; the same --at, else its first converged point), or a "
        "table t,x in a text file (a column headed like the dof, else the second); may be repeated",
    )
    sub.add_argument(
        "--integration",
        type=options.overlay,
        metavar="[LABEL:]PATH",
        help="draw below: a record of nhbm integrate, with the difference to it in a second panel",
    )
    sub.add_argument(
        "--difference", action="store_true", help="add a panel with the difference to the first overlay"
    )
    sub.add_argument(
        "--samples",
        type=options.count(2),
        metavar="N",
        help="samples in the window (default: 24 a period of the fastest harmonic)",
    )
    options.add_output(sub)

    sub = command(
        "spectrum",
        verbs.spectrum,
        "amplitudes of all harmonics (figure 8 of the paper)",
        "Draws |c_j| on a logarithmic scale: a map over (j1, j2) for two tones (the redundant half "
        "hatched), stems over j for one tone, stems over the frequency |j.omega| for three tones and more. Of a record of nhbm "
        "integrate it draws the harmonics at the tones.",
    )
    options.add_dof(sub)
    options.add_quantity(sub)
    options.add_point(sub)
    sub.add_argument(
        "--form", choices=("map", "bars", "stem"), help="map (default for two tones if it is well filled), 3-D bars, or stems"
    )
    sub.add_argument(
        "--over", choices=("tuple", "frequency"), default="tuple", help="axis: tuples (default) or frequency"
    )
    sub.add_argument(
        "--absolute", action="store_true", help="amplitudes in units, not relative to the largest"
    )
    options.add_decades(sub)
    options.add_output(sub)

    sub = command(
        "report",
        verbs.report_page,
        "a page of HTML that holds the whole file",
        "Writes one page of HTML of 5 MB at most, for which a browser needs no network: curves with stability and events; a click "
        "on a point shows its spectrum, motion, orbit, moving shape and error estimate; input and origin.",
    )
    options.add_model(sub)
    sub.add_argument("--output", "-o", type=Path, metavar="PATH", help="page to write (default: FILE.html)")

    sub = command(
        "orbit",
        verbs.orbit,
        "phase plane or orbit, with the section of a torus",
        "Draws the velocity of a degree of freedom over its displacement, or another degree of freedom over it (--with): over a "
        "period of one tone; of several over many periods, with the Poincare section where the phase of one tone is zero.",
    )
    options.add_dof(sub)
    sub.add_argument("--with", dest="other", metavar="LABEL", help="degree of freedom of the other axis (default: the velocity)")
    sub.add_argument("--section", type=options.count(1), default=1, metavar="N", help="tone of the section, from 1 (default 1)")
    options.add_quantity(sub)
    options.add_point(sub)
    options.add_output(sub)

    sub = command(
        "surface",
        verbs.surface,
        "motion over the phases of two tones",
        "Draws a degree of freedom over hypertime, as a 3-D surface or as a map; the phases of further tones are zero.",
    )
    options.add_dof(sub)
    options.add_quantity(sub)
    options.add_point(sub)
    sub.add_argument("--view", choices=("surface", "map"), default="surface", help="default: surface")
    options.add_output(sub)

    one_line = "If other values are swept, too, the points are those with the first of each, or with those that --where chooses."
    for name, help_text, description in (
        (
            "waterfall",
            "spectra along a sweep or curve",
            "Draws the spectra of 24 points at most, one above the other, stems of logarithmic height. " + one_line,
        ),
        (
            "campbell",
            "frequencies of all harmonics along a sweep or curve",
            "Draws each harmonic as a dot at its frequency over the swept value, coloured by its amplitude. " + one_line,
        ),
    ):
        sub = command(name, verbs.waterfall, help_text, description)
        options.add_dof(sub)
        options.add_quantity(sub)
        sub.add_argument("--over", metavar="PARAMETER", help="swept parameter (default: the number with most values)")
        options.add_where(sub)
        options.add_decades(sub, 4.0)
        options.add_output(sub)

    sub = command(
        "animate",
        verbs.animate,
        "a motion that moves, as GIF or MP4",
        "structure: a finite element model in motion; hypertime: the state on the torus of two tones, or in the phase plane of "
        "one, beside the motion in time. MP4 needs ffmpeg.",
    )
    sub.add_argument(
        "--view",
        choices=("structure", "hypertime"),
        help="default: structure where the run has a finite element model, else hypertime",
    )
    options.add_dof(sub)
    options.add_model(sub)
    options.add_quantity(sub)
    options.add_point(sub)
    options.add_window(sub, "motion")
    sub.add_argument("--frames", type=options.count(2), default=60, metavar="N", help="pictures (default 60)")
    sub.add_argument("--fps", type=options.count(1), default=20, metavar="N", help="pictures a second (default 20)")
    options.add_output(sub)
    sub.set_defaults(dpi=100)

    sub = command(
        "response",
        verbs.response,
        "response curve of a sweep",
        "Draws a measure of a degree of freedom over a swept parameter; further swept parameters, and further files, make "
        "several curves, by default seven at most. Points are counted as nhbm solve counts them. A solved point "
        "that exceeds a limit stands on its curve with the mark of its status, a point without motion in a row below, one a curve; "
        "curves are broken there, and where the motion jumps to another branch. What a &curve has followed is drawn along its "
        "arc, with folds and peaks marked and, where stability is known, unstable parts dashed and jumps off folds; files of "
        "normal modes after it are drawn over the frequency found, as backbones. --output NAME.csv writes the numbers in place "
        "of a picture.",
        several=True,
    )
    options.add_dof(sub)
    options.add_quantity(sub)
    sub.add_argument(
        "--over",
        metavar="PARAMETER",
        help="swept parameter of the x axis (default: the number with most values), or amplitude: the peak of --dof",
    )
    options.add_where(sub)
    options.add_measure(sub)
    sub.add_argument(
        "--curves", type=options.count(1), default=7, metavar="N", help="curves at most, spread evenly over the others (default 7)"
    )
    options.add_log(sub, "xy")
    options.add_output(sub)

    sub = command(
        "peaks",
        verbs.peaks,
        "table of folds and peaks",
        "Prints what was located on the curves of files of &curve: start, folds, peaks, wanted values and ends, with the measure "
        "of a degree of freedom there.",
        several=True,
    )
    options.add_dof(sub)
    options.add_quantity(sub)
    options.add_measure(sub)

    sub = command(
        "backbone",
        verbs.backbone,
        "frequency over amplitude or energy",
        "Draws the frequency of an unknown tone over the amplitude or the energy of a normal mode (normal_mode%amplitude or "
        "normal_mode%energy, whichever is swept), or over the peak of a degree of freedom (--over amplitude).",
        several=True,
    )
    options.add_dof(sub)
    sub.add_argument("--over", metavar="PARAMETER", help="swept parameter of the x axis, or amplitude: the peak of --dof")
    options.add_where(sub)
    sub.add_argument(
        "--tone", type=options.count(1), metavar="N", help="number of the tone, from 1 (default: the first unknown one)"
    )
    sub.add_argument("--curves", type=options.count(1), default=7, metavar="N", help="curves at most (default 7)")
    options.add_log(sub, "xy")
    options.add_output(sub)

    sub = command(
        "map",
        verbs.map,
        "a measure over two swept parameters",
        "Draws a measure of a degree of freedom as a map, a cell a point, over two parameters of a sweep. Cells of points that "
        "exceed a limit or have no motion carry the mark of their status. Further swept parameters must be fixed by --where.",
    )
    options.add_dof(sub)
    options.add_quantity(sub)
    sub.add_argument(
        "--over", type=options.pair, metavar="X,Y", help="swept parameters of both axes (default: the two with most values)"
    )
    options.add_where(sub)
    options.add_measure(sub)
    options.add_log(sub, "xyz", ", colours (z)")
    options.add_output(sub)

    sub = command(
        "multipliers",
        verbs.multipliers,
        "Floquet multipliers and the unit circle",
        "Draws the multipliers of all points, or of those that --where chooses, beside the unit circle, coloured along the "
        "swept parameter; those outside, which make a motion unstable, are crosses.",
    )
    options.add_where(sub)
    options.add_output(sub)

    sub = command(
        "rotor",
        verbs.rotor,
        "bladed disk and casing (figure 9 of the paper)",
        "For a structure of type rotor_stator. speeds: amplitudes and frequency of all points over the speed, with "
        "the critical speed; snapshots: disk and casing during one round of the casing's wave, in the stationary "
        "frame; wave: displacement of the casing over angle and time.",
    )
    sub.add_argument("--view", choices=("speeds", "snapshots", "wave"), default="speeds", help="default: speeds")
    options.add_point(sub)
    options.add_output(sub)

    sub = command(
        "vtk",
        verbs.vtk,
        "the motion of a structure in space, for ParaView",
        "Writes FILE_harmonics.vtu, the deflection shapes of harmonics (cos, sin and amplitude at each node), and FILE_motion.pvd "
        "with a folder of files, the motion and the forces of the laws over time. Reduced models give the motion of the full one.",
    )
    options.add_model(sub)
    options.add_point(sub)
    sub.add_argument(
        "--tuple", dest="tuples", type=options.tuple_of_integers, action="append", metavar="J1,J2,...",
        help="harmonic to write; may be repeated (default: the largest)",
    )  # fmt: skip
    sub.add_argument("--harmonics", type=options.count(1), default=8, metavar="N", help="harmonics to write at most (default 8)")
    options.add_window(sub, "motion")
    sub.add_argument(
        "--frames", type=options.count(0), default=48, metavar="N", help="moments of the motion, 0 for none (default 48)"
    )
    sub.add_argument("--output", "-o", type=Path, metavar="STEM", help="beginning of the names of the files")

    sub = command(
        "deflection",
        verbs.deflection,
        "deflected structure, one harmonic or one moment",
        "Draws the surface of a finite element model, deflected by a harmonic at its largest (--tuple) or by the motion at a "
        "moment (--time), coloured by the amplitude of the harmonic or the size of the displacement.",
    )
    options.add_model(sub)
    options.add_point(sub)
    choice = sub.add_mutually_exclusive_group()
    choice.add_argument("--tuple", type=options.tuple_of_integers, metavar="J1,J2,...", help="harmonic (default: the largest)")
    choice.add_argument("--time", type=options.finite, metavar="T", help="moment of the motion [s]")
    options.add_output(sub)

    sub = command(
        "contact",
        verbs.contact,
        "what contacts of a structure do: open, stick, slip, gaps, forces",
        "Draws the nodes of a law on a set. patch: share of the time that each is open, sticks and slips, smallest, mean and "
        "largest gap, largest forces, mean loss; time: which nodes are open, stick or slip at which moment, and the sum of "
        "their forces. Shares are those of a period, or of 32 periods of the slowest of several tones and 8 of their slowest beat.",
    )
    options.add_model(sub)
    sub.add_argument("--law", metavar="LABEL", help="label of the law (default: the first that is a contact)")
    sub.add_argument("--view", choices=("patch", "time"), help="default: patch, time of a single contact")
    options.add_point(sub)
    options.add_window(sub, "time")
    options.add_output(sub)

    for name, run, help_text, description in (
        (
            "work-precision",
            verbs.work_precision,
            "error over time of the points of a sequence of orders",
            "Draws the error of each point of a file of nhbm-bench over its wall time, one curve for each setting of all swept "
            "values but one number.",
        ),
        (
            "convergence",
            verbs.convergence,
            "error over order, or another swept number, with its rate",
            "Draws the error of each point of a file of nhbm-bench over the number that is swept and prints the rate, exponential "
            "or algebraic, whichever fits the falling part better.",
        ),
        (
            "cost",
            verbs.cost,
            "time over unknowns, with its exponent",
            "Draws the wall time of each point of a file of nhbm-bench over its number of unknowns and prints the exponent of "
            "the larger half.",
        ),
    ):
        sub = command(name, run, help_text, description)
        if name != "convergence":
            sub.add_argument(
                "--part",
                choices=("total", "cpu", "setup", "solver", "error_estimate"),
                default="total",
                help="which time (default: total, the wall time of the point; cpu: its processor time, which a "
                "busy machine hardly changes)",
            )
        else:
            sub.add_argument("--over", metavar="PATH", help="axis: a swept parameter or a size (default: what varies)")
        if name != "cost":
            sub.add_argument(
                "--improved",
                action="store_true",
                help="draw also the error of the improved motion (&error_estimate improvement_steps)",
            )
            sub.add_argument(
                "--reference",
                metavar="FILE[@POINT]",
                help="what errors are measured against: a point of a result file, a record of integration, or a table (.csv) with "
                "the columns dof, tuple ..., cos, sin (default: the solved point with the most harmonics)",
            )
            sub.add_argument(
                "--known",
                action="store_true",
                help="measure over the tuples of the reference alone, as always with a table",
            )
        options.add_output(sub)

    sub = command(
        "bench",
        verbs.bench,
        "time of each kernel over the size of a model, with its exponent",
        "Draws what nhbm-bench measured (residual, tangent, Newton step, solution, whole point) over harmonics, tones, unknowns, "
        "samples or a swept parameter, with the yardsticks, and prints the exponents of the larger half of the sizes.",
        file_help="file of nhbm-bench (HDF5)",
    )
    sub.add_argument("--also", type=Path, nargs="+", default=[], metavar="FILE", help="further files, such as of other tones")
    sub.add_argument(
        "--over", metavar="SIZE", help="n_harmonics, n_tones, ... or the path of a swept parameter (default: what varies)"
    )
    options.add_output(sub)

    shells.add_verbs(parser, commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
