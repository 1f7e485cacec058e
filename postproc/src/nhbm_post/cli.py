"""The command `nhbm-post`: pictures, tables and numbers from a result file."""

from __future__ import annotations

import argparse
import os
import re
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from . import __version__, report
from .bench import Bench, read_reference
from .errors import NhbmPostError, UsageError
from .march import read_displacement
from .measure import MEASURES, Measure
from .outcome import CONVERGED, words
from .reader import DAMAGES, QUANTITIES, Results
from .text import list_text

# matplotlib takes a second to load, so each command that draws imports nhbm_post.draw by itself.

_DESCRIPTION = """\
Draws and prints what is in an HDF5 result file of nhbm.

A point of a sweep is chosen by --point NUMBER or by --at PARAMETER=VALUE (path of a swept parameter in
the input, such as law(1)%gap, or its name in the file; values to six digits; repeat it for several
parameters). Without either it is the first converged point. Without --dof it is the first degree of freedom on which a law acts. Pictures go
next to the file and are named after it: beam.h5 gives beam_spectrum.png; --output chooses another
name, and its ending the format (.png, .pdf or .svg).
"""


class _Parser(argparse.ArgumentParser):
    """argparse, but a mistake gives one line and status 2."""

    def error(self, message):
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def main(argv: list[str] | None = None) -> int:
    """Runs one command; returns the exit status: 0, or 2 for a mistake of the user."""
    parser = _parser()
    arguments = parser.parse_args(_join_negative(sys.argv[1:] if argv is None else list(argv)))
    if "files" in arguments:
        arguments.file = arguments.files[0][1]
    try:
        arguments.run(arguments)
        sys.stdout.flush()
    except NhbmPostError as error:
        print(f"nhbm-post {arguments.command}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of a pipe, for example head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except DAMAGES as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        print(f"nhbm-post {arguments.command}: {arguments.file} cannot be read, it may be damaged ({what})", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="nhbm-post", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"nhbm-post {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)

    def command(name, run, help_text, description, file_help="result file of nhbm (HDF5)", several=False):
        sub = commands.add_parser(name, help=help_text, description=description)
        sub.set_defaults(run=run)
        if several:
            sub.add_argument(
                "files", type=_overlay, nargs="+", metavar="[LABEL:]FILE", help=file_help + "; several in one picture"
            )
        else:
            sub.add_argument("file", type=Path, metavar="FILE", help=file_help)
        return sub

    sub = command(
        "info",
        _info,
        "print what is in a file",
        "Prints title, version, swept parameters, counts of outcomes, and a row a point: parameters, status, "
        "iterations, residual, seconds and the largest amplitudes (or why the point failed).",
    )
    _add_dof(sub)
    sub.add_argument(
        "--points", type=_count(0), default=20, metavar="N", help="rows to print at most (default 20)"
    )

    sub = command(
        "value",
        _value,
        "print one harmonic with all digits",
        "Prints cos, sin and amplitude of one harmonic on one line, with 17 digits each. A mirrored tuple "
        "-j gives (cos, -sin) of the stored one.",
    )
    _add_dof(sub)
    _add_quantity(sub)
    _add_point(sub)
    sub.add_argument(
        "--tuple", type=_tuple, required=True, metavar="J1,J2,...", help="harmonic, for example 1,0 or 2,-1"
    )

    sub = command(
        "correction",
        _correction,
        "correction to the wall, four panels (figure 6 of the paper)",
        "Draws (a) the spectrum of the motion, (b) the motion over hypertime, (c) the same corrected to "
        "the wall, (d) the spectrum of the corrected motion. Uses the surfaces of the file if it has any "
        "(&output samples), else sums the coefficients and says so in the picture. With three tones or "
        "more the surfaces are the section at tau_3 = ... = 0.",
    )
    _add_dof(sub, "degree of freedom on which a law acts (default: the first)")
    _add_point(sub)
    sub.add_argument(
        "--view", choices=("surface", "map"), default="surface", help="3-D surfaces (default) or level maps"
    )
    sub.add_argument(
        "--samples",
        type=_count(4),
        default=96,
        metavar="N",
        help="samples a tone where surfaces are summed from coefficients (default 96)",
    )
    _add_decades(sub)
    _add_output(sub)

    sub = command(
        "time",
        _time,
        "motion over time (figures 4 and 7 of the paper)",
        "Draws a degree of freedom over time, for one or several points of a sweep, over other result "
        "files or over recorded time series. Default window: 8 periods of the slowest tone from t = 0, or "
        "the last 8 periods of an overlaid record.",
    )
    _add_dof(sub)
    _add_quantity(sub)
    _add_point(sub, several=True)
    sub.add_argument("--from", dest="t_from", type=float, metavar="T", help="start of the window [s]")
    sub.add_argument("--to", dest="t_to", type=float, metavar="T", help="end of the window [s]")
    sub.add_argument(
        "--level", type=float, metavar="X", help="draw a wall at this displacement, in the unit of the file"
    )
    sub.add_argument(
        "--overlay",
        type=_overlay,
        action="append",
        default=[],
        metavar="[LABEL:]PATH",
        help="draw below: a second result file (.h5; the same --at, else its first converged point), or a "
        "table t,x in a text file (a column headed like the dof, else the second); may be repeated",
    )
    sub.add_argument(
        "--march",
        type=_overlay,
        metavar="[LABEL:]PATH",
        help="draw below: a record of nhbm march, with the difference to it in a second panel",
    )
    sub.add_argument(
        "--difference", action="store_true", help="add a panel with the difference to the first overlay"
    )
    sub.add_argument(
        "--samples",
        type=_count(2),
        metavar="N",
        help="samples in the window (default: 24 a period of the fastest harmonic)",
    )
    _add_output(sub)

    sub = command(
        "spectrum",
        _spectrum,
        "amplitudes of all harmonics (figure 8 of the paper)",
        "Draws |c_j| on a logarithmic scale: a map over (j1, j2) for two tones (the redundant half "
        "hatched), stems over j for one tone, stems over the frequency |j.omega| for three tones and more.",
    )
    _add_dof(sub)
    _add_quantity(sub)
    _add_point(sub)
    sub.add_argument(
        "--form", choices=("map", "bars", "stem"), help="map (default for two tones), 3-D bars, or stems"
    )
    sub.add_argument(
        "--over", choices=("tuple", "frequency"), default="tuple", help="axis: tuples (default) or frequency"
    )
    sub.add_argument(
        "--absolute", action="store_true", help="amplitudes in units, not relative to the largest"
    )
    _add_decades(sub)
    _add_output(sub)

    sub = command(
        "response",
        _response,
        "response curve of a sweep",
        "Draws a measure of a degree of freedom over a swept parameter; further swept parameters, and further files, make "
        "several curves, seven at most unless told otherwise. Points are counted as nhbm solve counts them. A solved point "
        "that has not converged stands on its curve with the mark of its status, any other in a row below, one a curve; "
        "curves are broken there, and where the motion jumps to another branch. What a &curve has followed is drawn along its arc, with "
        "folds and peaks marked and, where stability is known, unstable parts dashed; files of normal modes after it are drawn over the "
        "frequency found, as backbones.",
        several=True,
    )
    _add_dof(sub)
    _add_quantity(sub)
    sub.add_argument(
        "--over",
        metavar="PARAMETER",
        help="swept parameter of the x axis (default: the number with most values), or amplitude: the peak of --dof",
    )
    _add_where(sub)
    _add_measure(sub)
    sub.add_argument(
        "--curves", type=_count(1), default=7, metavar="N", help="curves at most, spread evenly over the others (default 7)"
    )
    _add_log(sub, "xy")
    _add_output(sub)

    sub = command(
        "peaks",
        _peaks,
        "table of folds and peaks",
        "Prints what was located on the curves of files of &curve: start, folds, peaks, wanted values and ends, with the measure "
        "of a degree of freedom there.",
        several=True,
    )
    _add_dof(sub)
    _add_quantity(sub)
    _add_measure(sub)

    sub = command(
        "backbone",
        _backbone,
        "frequency over amplitude or energy",
        "Draws the frequency of an unknown tone over the amplitude or the energy of a normal mode (normal_mode%%amplitude or "
        "normal_mode%%energy, whichever is swept), or over the peak of a degree of freedom (--over amplitude).",
        several=True,
    )
    _add_dof(sub)
    sub.add_argument("--over", metavar="PARAMETER", help="swept parameter of the x axis, or amplitude: the peak of --dof")
    _add_where(sub)
    sub.add_argument("--tone", type=_count(1), metavar="N", help="number of the tone, from 1 (default: the first unknown one)")
    sub.add_argument("--curves", type=_count(1), default=7, metavar="N", help="curves at most (default 7)")
    _add_log(sub, "xy")
    _add_output(sub)

    sub = command(
        "map",
        _map,
        "a measure over two swept parameters",
        "Draws a measure of a degree of freedom as a map, a cell a point, over two parameters of a sweep. Cells of points that "
        "have not converged carry the mark of their status. Further swept parameters must be fixed by --where.",
    )
    _add_dof(sub)
    _add_quantity(sub)
    sub.add_argument(
        "--over", type=_pair, metavar="X,Y", help="swept parameters of both axes (default: the two with most values)"
    )
    _add_where(sub)
    _add_measure(sub)
    _add_log(sub, "xyz", ", colours (z)")
    _add_output(sub)

    sub = command(
        "multipliers",
        _multipliers,
        "Floquet multipliers and the unit circle",
        "Draws the multipliers of all points, or of those that --where chooses, beside the unit circle, coloured along the "
        "swept parameter; those outside, which make a motion unstable, are crosses.",
    )
    _add_where(sub)
    _add_output(sub)

    sub = command(
        "plan",
        _plan,
        "forecast of a run over many ranks",
        "Draws the table of `nhbm plan INPUT -o FILE`: over the number of ranks the shares of solving (the "
        "efficiency), of shared counters, of writing and of waiting in the time of all ranks, and the wall time.",
        file_help="table of nhbm plan (comma-separated values)",
    )
    _add_output(sub)

    sub = command(
        "rotor",
        _rotor,
        "bladed disk and casing (figure 9 of the paper)",
        "For a structure of type rotor_stator. speeds: amplitudes and frequency of all points over the speed, with "
        "the critical speed; snapshots: disk and casing during one round of the casing's wave, in the stationary "
        "frame; wave: displacement of the casing over angle and time.",
    )
    sub.add_argument("--view", choices=("speeds", "snapshots", "wave"), default="speeds", help="default: speeds")
    _add_point(sub)
    _add_output(sub)

    sub = command(
        "vtk",
        _vtk,
        "the motion of a structure in space, for ParaView",
        "Writes FILE_harmonics.vtu, the deflection shapes of harmonics (cos, sin and amplitude at each node), and FILE_motion.pvd with "
        "a folder of files, the motion over time. Reduced models give the motion of the full one.",
    )
    sub.add_argument("--model", type=Path, required=True, metavar="MODEL", help="model file of the run")
    _add_point(sub)
    sub.add_argument(
        "--tuple", dest="tuples", type=_tuple, action="append", metavar="J1,J2,...",
        help="harmonic to write; may be repeated (default: the largest)",
    )  # fmt: skip
    sub.add_argument("--harmonics", type=_count(1), default=8, metavar="N", help="harmonics to write at most (default 8)")
    sub.add_argument("--from", dest="t_from", type=float, default=0.0, metavar="T", help="start of the motion [s] (default 0)")
    sub.add_argument("--to", dest="t_to", type=float, metavar="T", help="its end [s] (default: a period of the slowest tone later)")
    sub.add_argument("--frames", type=_count(0), default=48, metavar="N", help="moments of the motion, 0 for none (default 48)")
    sub.add_argument("--output", "-o", type=Path, metavar="STEM", help="beginning of the names of the files")

    sub = command(
        "deflection",
        _deflection,
        "deflected structure, one harmonic or one moment",
        "Draws the surface of a finite element model, deflected by a harmonic at its largest (--tuple) or by the motion at a moment "
        "(--time), coloured by the amplitude of the harmonic or the size of the displacement.",
    )
    sub.add_argument("--model", type=Path, required=True, metavar="MODEL", help="model file of the run")
    _add_point(sub)
    choice = sub.add_mutually_exclusive_group()
    choice.add_argument("--tuple", type=_tuple, metavar="J1,J2,...", help="harmonic (default: the largest)")
    choice.add_argument("--time", type=float, metavar="T", help="moment of the motion [s]")
    _add_output(sub)

    for name, run, help_text, description in (
        (
            "work-precision",
            _work_precision,
            "error over time of the points of a ladder",
            "Draws the error of each point of a file of nhbm bench over its wall time, one curve for each setting of all swept "
            "values but one number.",
        ),
        (
            "convergence",
            _convergence,
            "error over order, or another swept number, with its rate",
            "Draws the error of each point of a file of nhbm bench over the number that is swept and prints the rate, exponential "
            "or algebraic, whichever fits the falling part better.",
        ),
        (
            "cost",
            _cost,
            "time over unknowns, with its exponent",
            "Draws the wall time of each point of a file of nhbm bench over its number of unknowns and prints the exponent of "
            "the larger half.",
        ),
    ):
        sub = command(name, run, help_text, description)
        if name != "convergence":
            sub.add_argument(
                "--part",
                choices=("total", "cpu", "setup", "solver", "certificate"),
                default="total",
                help="which time (default: total, the wall time of all but the certificate; cpu: its processor time, which a busy "
                "machine hardly changes)",
            )
        else:
            sub.add_argument("--over", metavar="PATH", help="axis: a swept parameter or a size (default: what varies)")
        if name != "cost":
            sub.add_argument(
                "--improved",
                action="store_true",
                help="draw also the error of the improved motion (&certificate improvement_steps)",
            )
            sub.add_argument(
                "--reference",
                metavar="FILE[@POINT]",
                help="what errors are measured against: a point of a result file, a record of a march, or a table (.csv) with the "
                "columns dof, tuple ..., cos, sin (default: the solved point with the most harmonics)",
            )
            sub.add_argument(
                "--known",
                action="store_true",
                help="measure over the tuples of the reference alone, as always with a table",
            )
        _add_output(sub)

    sub = command(
        "bench",
        _bench,
        "time of each kernel over the size of a scene, with its exponent",
        "Draws what nhbm bench measured (residual, tangent, Newton step, solution, whole point) over harmonics, tones, unknowns, "
        "samples or a swept parameter, with the yardsticks, and prints the exponents of the larger half of the sizes.",
        file_help="file of nhbm bench (HDF5)",
    )
    sub.add_argument("--also", type=Path, nargs="+", default=[], metavar="FILE", help="further files, such as of other tones")
    sub.add_argument(
        "--over", metavar="SIZE", help="n_harmonics, n_tones, ... or the path of a swept parameter (default: what varies)"
    )
    _add_output(sub)
    return parser


# Options that several commands share


def _add_dof(sub, text="degree of freedom, for example v3 (default: the first on which a law acts)"):
    sub.add_argument("--dof", metavar="LABEL", help=text)


def _add_quantity(sub):
    sub.add_argument(
        "--of",
        dest="quantity",
        choices=tuple(QUANTITIES),
        default="motion",
        help="motion (default), force of the laws, motion corrected to the wall, or improved in a wider set",
    )


def _add_point(sub, several=False):
    choice = sub.add_mutually_exclusive_group()
    if several:
        choice.add_argument(
            "--point",
            type=_numbers,
            metavar="N,N,...",
            help="numbers of the points (default: first converged)",
        )
    else:
        choice.add_argument(
            "--point", type=_count(0), metavar="N", help="number of the point (default: first converged)"
        )
    choice.add_argument(
        "--at",
        type=_assignment,
        action="append",
        default=[],
        metavar="PARAMETER=VALUE",
        help="point with this value of a swept parameter, for example law(1)%%gap=1.5e-3; may be repeated"
        + ("; all points that fit are drawn" if several else ""),
    )
    sub.add_argument(
        "--unconverged", action="store_true", help="take also points that ended without convergence"
    )


def _add_where(sub):
    sub.add_argument(
        "--where",
        "--at",
        dest="where",
        type=_assignment,
        action="append",
        default=[],
        metavar="PARAMETER=VALUE",
        help="only points with this value of a swept parameter, for example law(1)%%gap=1.5e-3; a list 1e-3,2e-3 and a range "
        "1e-3:2e-3 will do as well; may be repeated",
    )


def _add_measure(sub):
    sub.add_argument(
        "--measure",
        choices=MEASURES,
        help="peak: max|x| over hypertime (default); rms; harmonic: amplitude of --tuple; frequency: that of a tone",
    )
    sub.add_argument("--tuple", type=_tuple, metavar="J1,J2,...", help="harmonic to draw, for example 1,0")
    sub.add_argument("--tone", type=_count(1), metavar="N", help="number of the tone, from 1 (default: the first unknown one)")


def _add_log(sub, letters, more=""):
    sub.add_argument(
        "--log",
        dest="logarithmic",
        type=_letters(letters),
        metavar="AXES",
        help=f"logarithmic axes: letters of {letters}{more}, or none (default: x{' and y' if 'z' in letters else ''} where the "
        "sweep runs so)",
    )


def _letters(known):
    def convert(text):
        if text != "none" and (not text or set(text) - set(known)):
            raise argparse.ArgumentTypeError(f"'{text}' is no choice of axes; write letters of {known}, or none")
        return text

    return convert


def _pair(text):
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names) or names[0] == names[1]:
        raise argparse.ArgumentTypeError(f"'{text}' is no pair of parameters; write for example law(1)%gap,load(1)%cos")
    return tuple(names)


def _add_decades(sub):
    sub.add_argument(
        "--decades",
        type=_positive,
        default=8.0,
        metavar="N",
        help="range of the amplitude scale below the largest (default 8)",
    )


def _add_output(sub):
    sub.add_argument("--output", "-o", type=Path, metavar="PATH", help="picture to write: .png, .pdf or .svg")
    sub.add_argument(
        "--dpi", type=_count(20), default=200, metavar="N", help="dots per inch of a .png (default 200)"
    )


def _count(least):
    def convert(text):
        number = int(text)
        if number < least:
            raise argparse.ArgumentTypeError(f"{text} is less than {least}")
        return number

    convert.__name__ = "whole number"
    return convert


def _positive(text):
    number = float(text)
    if not 0.0 < number < 300.0:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 300")
    return number


def _numbers(text):
    try:
        numbers = [int(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no list of points; write for example 0,2,5") from None
    return numbers


def _tuple(text):
    try:
        return tuple(int(part) for part in text.strip("() ").split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"'{text}' is no tuple of integers; write for example 1,0 or 2,-1"
        ) from None


def _assignment(text):
    name, mark, value = text.partition("=")
    if not (mark and name.strip() and value.strip()):
        raise argparse.ArgumentTypeError(f"'{text}' is no PARAMETER=VALUE; write for example law(1)%gap=1.5e-3")
    return name.strip(), value.strip()


def _overlay(text):
    label, mark, path = text.rpartition(":")
    return (label, Path(path)) if mark and label and not Path(text).exists() else ("", Path(text))


def _join_negative(words: list[str]) -> list[str]:
    """`--tuple -1,0` becomes `--tuple=-1,0`, because argparse takes `-1,0` and `-1e-3` for options."""
    joined: list[str] = []
    for word in words:
        is_value = re.match(r"-[.\d]", word) and joined and re.match(r"--[a-z]+$", joined[-1])
        if is_value:
            joined[-1] += "=" + word
        else:
            joined.append(word)
    return joined


# Commands


def _info(arguments):
    with Results(arguments.file) as results:
        print(report.info(results, arguments.dof, arguments.points))


def _value(arguments):
    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        dof = arguments.dof or results.default_dof(arguments.quantity)
        print(report.value(results, point, dof, arguments.tuple, arguments.quantity, arguments.unconverged))


def _correction(arguments):
    from . import draw

    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        fig = draw.draw_correction(
            results,
            point,
            arguments.dof,
            view=arguments.view,
            decades=arguments.decades,
            n_samples=arguments.samples,
            allow_unconverged=arguments.unconverged,
        )
    _save(fig, arguments)


def _spectrum(arguments):
    from . import draw

    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        series = results.series(point, arguments.dof, arguments.quantity, arguments.unconverged)
        fig = draw.draw_spectrum(
            series,
            title=_origin(results, point, arguments.quantity),
            form=arguments.form,
            over=arguments.over,
            decades=arguments.decades,
            is_normalised=not arguments.absolute,
        )
    _save(fig, arguments)


def _response(arguments):
    _draw_response(arguments, lambda results: _measure(arguments, results), arguments.over)


def _peaks(arguments):
    with ExitStack() as stack:
        files = [(label or path.stem, stack.enter_context(Results(path))) for label, path in arguments.files]
        print(report.peaks(files, _measure(arguments, files[0][1]), arguments.dof))


def _backbone(arguments):
    def measure(results):
        if arguments.over is None and not any(path in results.swept for path in _BACKBONES):
            raise UsageError(
                f"{results.path}: neither {' nor '.join(_BACKBONES)} is swept; say --over (swept: {list_text(results.swept)}, "
                "or amplitude)"
            )
        return Measure("frequency", tone=_tone(arguments, results))

    over = arguments.over
    if over is None:
        with Results(arguments.file) as results:
            over = next((path for path in _BACKBONES if path in results.swept), None)
    _draw_response(arguments, measure, over)


_BACKBONES = ("normal_mode%amplitude", "normal_mode%energy")


def _draw_response(arguments, measure, over):
    from . import draw

    with ExitStack() as stack:
        files = [(label or path.stem, stack.enter_context(Results(path))) for label, path in arguments.files]
        (label, results), others = files[0], files[1:]
        fig = draw.draw_response(
            results,
            arguments.dof,
            measure=measure(results),
            over=over,
            where=dict(arguments.where),
            logarithmic=arguments.logarithmic,
            n_curves=arguments.curves,
            label=label,
            others=others,
        )
        for _, results in files:
            print((f"{results.path}: " if others else "") + results.outcome_text())
    _save(fig, arguments)


def _map(arguments):
    from . import draw

    with Results(arguments.file) as results:
        fig = draw.draw_map(
            results,
            arguments.dof,
            measure=_measure(arguments, results),
            over=arguments.over,
            where=dict(arguments.where),
            logarithmic=arguments.logarithmic,
        )
        print(results.outcome_text())
    _save(fig, arguments)


def _multipliers(arguments):
    from . import draw

    with Results(arguments.file) as results:
        fig = draw.draw_multipliers(results, where=dict(arguments.where))
    _save(fig, arguments)


def _measure(arguments, results: Results):
    """What --measure, --tuple, --tone and --of ask for."""
    name = arguments.measure or ("harmonic" if arguments.tuple else "frequency" if arguments.tone else "peak")
    if (name == "harmonic") != (arguments.tuple is not None):
        raise UsageError("--measure harmonic and --tuple belong together")
    if arguments.tone and name != "frequency":
        raise UsageError("--tone belongs to --measure frequency")
    if arguments.tuple and len(arguments.tuple) != results.n_tones:
        raise UsageError(f"--tuple has {len(arguments.tuple)} entries; {results.path} has {results.n_tones} tones")
    tone = _tone(arguments, results) if name == "frequency" else 0
    return Measure(name, arguments.tuple, tone, arguments.quantity)


def _tone(arguments, results: Results) -> int:
    """Number of the tone, from 0: as told, else the first whose frequency was unknown, else the first."""
    if arguments.tone is not None:
        if arguments.tone > results.n_tones:
            raise UsageError(f"{results.path}: no tone {arguments.tone}; tones: 1 to {results.n_tones}")
        return arguments.tone - 1
    unknown = results.unknown_tones()
    return int(unknown[0]) if unknown.size else 0


def _plan(arguments):
    from . import draw

    _save(draw.draw_plan(arguments.file), arguments)


def _rotor(arguments):
    from . import draw

    with Results(arguments.file) as results:
        point = 0 if arguments.view == "speeds" else results.point(arguments.point, dict(arguments.at))
        fig = draw.draw_rotor(results, point, arguments.view)
    _save(fig, arguments, arguments.view)


def _deflection(arguments):
    from . import draw
    from .structure import Structure, harmonic_of, motions

    structure = Structure(arguments.model)
    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        tuples, frequencies, coefficients = motions(results, structure, point, arguments.unconverged)
    if arguments.time is not None:
        motion = (coefficients * np.exp(1j * frequencies * arguments.time)).real.sum(axis=1)
        field = structure.displacement(motion)
        fig = draw.draw_deflection(structure, field, np.linalg.norm(field, axis=1), f"t = {arguments.time:g} s")
    else:
        h = harmonic_of(tuples, coefficients, arguments.tuple)
        shape = structure.displacement(coefficients[:, h].real) + 1j * structure.displacement(coefficients[:, h].imag)
        largest = shape.ravel()[np.argmax(np.abs(shape))]
        moment = (shape * np.exp(-1j * np.angle(largest))).real
        words = f"harmonic ({','.join(map(str, tuples[h]))}), {abs(frequencies[h]):.6g} rad/s"
        fig = draw.draw_deflection(structure, moment, np.linalg.norm(np.abs(shape), axis=1), words)
    _save(fig, arguments)


def _vtk(arguments):
    from .structure import Structure, motions, write_harmonics, write_motion

    structure = Structure(arguments.model)
    stem = arguments.output or arguments.file.with_suffix("")
    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        tuples, frequencies, coefficients = motions(results, structure, point, arguments.unconverged)
        slowest = float(np.abs(results.frequency(point)).min())
    path = stem.with_name(f"{stem.name}_harmonics.vtu")
    written = write_harmonics(structure, tuples, coefficients, path, arguments.tuples, arguments.harmonics)
    print(f"{path}: {len(written)} harmonics, {list_text([','.join(map(str, j)) for j in written])}")
    if arguments.frames == 0:
        return
    end = arguments.t_from + 2 * np.pi / slowest if arguments.t_to is None else arguments.t_to
    if not end > arguments.t_from:
        raise UsageError("the motion must end after it begins: --to above --from")
    path = stem.with_name(f"{stem.name}_motion.pvd")
    times = np.linspace(arguments.t_from, end, arguments.frames, endpoint=False)
    write_motion(structure, frequencies, coefficients, path, times)
    print(f"{path}: {len(times)} moments from {arguments.t_from:g} s to {end:g} s")


def _time(arguments):
    from . import draw
    from .draw.time_history import Record, read_record

    at = dict(arguments.at)
    with Results(arguments.file) as results:
        if arguments.point is not None:
            points = [results.point(number) for number in arguments.point]
        elif at:
            points = results.select(at)
        else:
            points = [results.point()]
        dof = arguments.dof or results.default_dof(arguments.quantity)
        curves = [
            (
                _legend(results, point, points),
                results.series(point, dof, arguments.quantity, arguments.unconverged),
            )
            for point in points
        ]
        outcome = results.warning(points[0]) if len(points) == 1 else ""
        title = ", ".join(part for part in (results.title, *_common_parameters(results, points), outcome) if part)
    references = []
    if arguments.march:
        label, path = arguments.march
        if arguments.quantity == "force":
            raise UsageError("--march compares motions: a record has forces by coordinate of a law, not by dof")
        method, t, x = read_displacement(path, dof)
        references.append(Record(label or f"marching, {method}", t, x))
    for label, path in arguments.overlay:
        if path.suffix.lower() in (".h5", ".hdf5", ".nc"):
            with Results(path) as other:
                known = {key: value for key, value in at.items() if key in other.parameters}
                point = other.point(at=known)
                series = other.series(point, dof, arguments.quantity, arguments.unconverged)
                references.append((_with_status(label or f"{path.stem}, {other.point_text(point)}", other, point), series))
        else:
            record = read_record(path, dof)
            references.append(type(record)(label, record.t, record.x) if label else record)
    fig = draw.draw_time(
        curves,
        references,
        title=title,
        t_from=arguments.t_from,
        t_to=arguments.t_to,
        level=arguments.level,
        n_samples=arguments.samples,
        has_difference=arguments.difference or bool(arguments.march),
    )
    _save(fig, arguments)


def _work_precision(arguments):
    from . import draw

    bench = Bench(arguments.file)
    _save(draw.draw_work_precision(bench, _errors(bench, arguments), part=arguments.part), arguments)


def _convergence(arguments):
    from . import draw

    bench = Bench(arguments.file)
    over = arguments.over or bench.varying()
    fig, rates = draw.draw_convergence(bench, _errors(bench, arguments), over=over)
    for curve, rate in rates:
        print(f"{curve.label}: " + (f"error ~ {rate.plain(over)}" if rate else "too few points for a rate"))
    _save(fig, arguments)


def _errors(bench: Bench, arguments):
    from . import draw

    reference = read_reference(arguments.reference) if arguments.reference else None
    only_known = arguments.known or str(arguments.reference).endswith(".csv")
    plain, improved = (
        bench.errors(reference, only_known=only_known, is_improved=which) for which in (False, True)
    )
    return draw.Errors(plain, improved if arguments.improved else None)


def _cost(arguments):
    from . import draw

    fig, exponents = draw.draw_cost(Bench(arguments.file), part=arguments.part)
    for curve, rate in exponents:
        print(f"{curve.label}: " + (f"time ~ {rate.plain('unknowns')}" if rate else f"no exponent, {rate.reason}"))
    _save(fig, arguments)


def _bench(arguments):
    from . import draw

    fig, exponents, notes = draw.draw_bench(Bench(arguments.file, *arguments.also), arguments.over)
    for kernel, rate in exponents:
        print(f"{kernel}: " + (f"time ~ {rate.plain('n')}" if rate else f"no exponent, {rate.reason}"))
    for note in notes:
        print(note)
    _save(fig, arguments)


def _legend(results: Results, point: int, points: list[int]) -> str:
    """What tells a point from the others drawn with it, or the method where it is alone."""
    series_text = f"{results.n_tones}-HBM"
    differing = [
        p.text(point) for p in results.parameters.values() if len({str(v) for v in p.values[points]}) > 1
    ]
    if len(points) == 1:
        return f"{series_text}, {int(results.per_point('n_harmonics')[point])} harmonics"
    return _with_status(f"{series_text}, " + (", ".join(differing) or f"point {point}"), results, point)


def _with_status(label: str, results: Results, point: int) -> str:
    """A legend that says how the point ended, unless it has converged."""
    return label if results.status[point] == CONVERGED else f"{label} ({words(results.status_name(point))})"


def _common_parameters(results: Results, points: list[int]) -> list[str]:
    return [
        p.text(points[0]) for p in results.parameters.values() if len({str(v) for v in p.values[points]}) == 1
    ]


def _quantity_words(quantity: str) -> str:
    return "" if quantity == "motion" else QUANTITIES[quantity].words


def _origin(results: Results, point: int, quantity: str) -> str:
    parts = [results.title, results.point_text(point), _quantity_words(quantity)]
    if results.warning(point):
        parts.append(results.warning(point))
    return ", ".join(part for part in parts if part)


def _save(fig, arguments, *parts: str) -> None:
    """Writes the picture under the name asked for, else under that of the file, the command and `parts` of it."""
    from . import draw

    name = "_".join([arguments.file.stem, arguments.command, *parts])
    output = arguments.output or arguments.file.with_name(f"{name}.png")
    print(f"wrote {draw.save(fig, output, arguments.dpi)}")


if __name__ == "__main__":
    sys.exit(main())
