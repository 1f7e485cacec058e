"""nhbm-model: finite element models for nhbm."""

from __future__ import annotations

import argparse
import re
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from nhbm import __version__, assembly, cyclic, examples, importing, reduction, rotors, shells, surfaces
from nhbm.arguments import Parser
from nhbm.checks import check
from nhbm.child_process import is_input, run_in_child_process
from nhbm.errors import Implausible, ModelError, NotConverged
from nhbm.factors import dense_modes, symmetric_part
from nhbm.structure import CONTACT_DIRECTIONS, MATRICES, Structure

OK, NOT_GOOD, WRONG, INTERRUPTED = 0, 1, 2, 3
_UNITS = {"young": "[Pa]", "density": "[kg/m3]"} | dict.fromkeys(
    ("length", "width", "height", "thickness", "hub", "rim", "platform", "tip", "inner", "outer"), "[m]"
)


def main_in_child_process() -> int:
    """The command `nhbm-model`."""
    program = _program(sys.argv[1:])
    return run_in_child_process(main, program, INTERRUPTED if program == "nhbm" else None)


def _program(arguments: Any) -> str:
    """The name in messages: `nhbm fit` is run as `nhbm-model fit`."""
    return "nhbm" if list(arguments[:1]) == ["fit"] else "nhbm-model"


def main(arguments: Any = None) -> int:
    """Runs the command and returns its exit status: 0, 1 for a model that is not sound, 2 for what cannot be done."""
    options = parser().parse_args(arguments)
    program = _program([options.verb])
    try:
        if "output" in options:
            _check_output(options)
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_: print(f"{program}: warning: {message}", file=sys.stderr)
            return options.run(options)
    except ModelError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return WRONG
    except OSError as error:
        print(f"{program}: {error.filename or ''}: {error.strerror or error}", file=sys.stderr)
        return WRONG
    except MemoryError:
        print(f"{program} {options.verb}: there is not enough memory", file=sys.stderr)
        return WRONG
    except Exception as error:  # of a damaged input SciPy, h5py and meshio raise whatever they meet
        why = " ".join(f"{type(error).__name__}: {error}".split())
        print(f"{program} {options.verb}: this cannot be done with the files and options given ({why})", file=sys.stderr)
        return WRONG


def parser() -> argparse.ArgumentParser:
    top = Parser(prog="nhbm-model", description="Models for nhbm: import, check, reduce finite elements, fit.")
    top.add_argument("--version", action="version", version=f"nhbm-model {__version__}")
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")

    def add(name: str, text: str, more: str = "", **options: Any) -> argparse.ArgumentParser:
        """A verb, with a text for the list of all, also above its own help unless there is more to say."""
        described = more or f"{text[:1].upper()}{text[1:]}."
        return verbs.add_parser(name, help=text, description=described.replace("%", "%%"), **options)

    verb = add("import", "create a model file from matrices of other programs")
    verb.set_defaults(run=run_import)
    verb.add_argument("--calculix", metavar="STEM", help="STEM.sti, STEM.mas and STEM.dof of SOLVER=MATRIXSTORAGE")
    verb.add_argument("--abaqus", action="store_true", help="the matrices are Abaqus' MATRIX INPUT (.mtx)")
    verb.add_argument("--nastran", metavar="FILE", help="bulk data or punch file; the matrices are names of its DMIG")
    verb.add_argument("--ansys", metavar="FILE", help="assembled matrices of Ansys (.full)")
    verb.add_argument("--substructure", metavar="FILE", help="Abaqus' SUBSTRUCTURE MATRIX OUTPUT (.mtx)")
    verb.add_argument("--op4", metavar="FILE", help="OUTPUT4 of Nastran; the matrices are names in it, kaa#2 for the second kaa")
    verb.add_argument("--matlab", metavar="FILE", help="a .mat file; the matrices are names of its variables")
    verb.add_argument("--ross", metavar="FILE", help="a rotor of ROSS (.toml)")
    verb.add_argument("--speed", type=float, metavar="RAD/S", help="of the rotor, where its bearings depend on it")
    verb.add_argument("--frequency", type=float, metavar="RAD/S", help="of the whirl, for tables of bearings (default: the speed)")
    for name in MATRICES:
        verb.add_argument(f"--{name}", metavar="FILE", help=f"{name} matrix: Matrix Market (.mtx), Harwell-Boeing (.hb), .npz")
    verb.add_argument("--labels", metavar="FILE",
                      help="names of degrees of freedom, such as n12.z, a line each; Ansys' mapping; Nastran's EXTRN")  # fmt: skip
    verb.add_argument("--mesh", metavar="FILE", help="coordinates, cells and sets: .inp, .bdf, .cdb, .msh, others of meshio")
    verb.add_argument("--in-order", action="store_true", help="node k is the k-th of a mesh whose format has no numbers of nodes")
    verb.add_argument("--drop-empty", action="store_true", help="leave out rows that have neither mass nor stiffness")
    verb.add_argument("--set", action="append", default=[], metavar="NAME=N,N,...", help="a node set by node numbers")
    _loads(verb)
    verb.add_argument("--units", default="m kg s", help="unit system, for information only (default: m kg s)")
    _output(verb)

    verb = add("fit", "fit parameters of an input to a measured response over the frequency", prog="nhbm fit")
    verb.set_defaults(run=run_fit)
    verb.add_argument("input", help="input file; its values are the first guess")
    verb.add_argument("data", help="CSV with columns frequency or hertz, amplitude; optional: phase [rad], negative for a lag, "
                                   "sweep (up, down), sigma, values of the input by path; the two files may stand in either "
                                   "order")  # fmt: skip
    verb.add_argument("--by", action="append", required=True, metavar="PATH", help="a parameter, such as law(stop)%%gap")
    verb.add_argument("--force", type=float, metavar="N", help="amplitude of the force of a universal file (.uff)")
    verb.add_argument("--function", metavar="NAME", help="which one of a universal file, such as 12:+Z/3:+Z")
    verb.add_argument("--unit", metavar="UNIT", help="of its values where it does not tell them, such as m/s^2/N, g/lbf or mm")
    verb.add_argument("--of", required=True, metavar="RESPONSE", help="the harmonic that was measured, such as 'x1 (1)'")
    verb.add_argument("--order", type=int, metavar="N", help="order of the harmonics")
    verb.add_argument("--tolerance", type=float, metavar="T", help="instead: relative error of the motions (default: 0.01)")
    verb.add_argument("--noise", type=float, metavar="SHARE", help="relative standard deviation of amplitudes (default: estimated)")
    verb.add_argument("--controlled", action="store_true",
                      help="response or phase was controlled: points may be on unstable branches")  # fmt: skip
    verb.add_argument("--or", dest="other", metavar="INPUT", help="another model, to be compared by the evidence of the data")
    verb.add_argument("--or-by", action="append", default=[], metavar="PATH", help="a parameter of the other model")
    verb.add_argument("--write", metavar="INPUT", help="write the complete input with the fitted values")
    verb.add_argument("--picture", metavar="FILE", help="draw data, fit and residuals (.png, .pdf, .svg)")

    verb = add("info", "contents of a model file")
    verb.set_defaults(run=run_info)
    verb.add_argument("model", help="model file")

    verb = add("check", "symmetry, definiteness, rigid body modes, plausible units")
    verb.set_defaults(run=run_check)
    verb.add_argument("model", help="model file")

    for name, make in (
        ("beam", examples.beam),
        ("plate", examples.plate),
        ("solid", examples.solid),
        ("sector", examples.sector),
        ("ring", examples.ring),
    ):
        text = " ".join(str(make.__doc__).split())
        verb = add(name, f"an example by scikit-fem: {re.split('[:;.]', text)[0]}", text)
        verb.set_defaults(run=run_example, make=make)
        for key, default in zip(make.__code__.co_varnames, make.__defaults__ or ()):
            verb.add_argument(f"--{key.replace('_', '-')}", dest=key, type=type(default), default=default,
                              help=f"{_UNITS.get(key, '')} (default: {default})".strip())  # fmt: skip
        verb.add_argument("--node-set", action="append", default=[], metavar="NAME=X,Y,Z",
                          help="set of the nodes closest to positions; X,Y,Z;X,Y,Z for several")  # fmt: skip
        _loads(verb)
        _output(verb)

    verb = add("rotor", "a shaft with disks in bearings, by beam elements")
    verb.set_defaults(run=run_rotor)
    verb.add_argument("--length", type=float, default=0.6, help="[m] (default: 0.6)")
    verb.add_argument("--diameter", type=float, default=0.02, help="[m] (default: 0.02)")
    verb.add_argument("--n-elements", type=int, default=12, help="(default: 12)")
    verb.add_argument("--disk", action="append", default=[], metavar="POSITION,MASS,DIAMETRAL,POLAR",
                      help="[m], [kg], moments of inertia [kg m2]; at the nearest node, like bearings")  # fmt: skip
    verb.add_argument("--bearing", action="append", default=[], metavar="POSITION,STIFFNESS,DAMPING", help="[m], [N/m], [N s/m]")
    verb.add_argument(
        "--speed",
        type=float,
        metavar="RAD/S",
        help="speed of the gyroscopic terms (default: given by the key speed of &structure)",
    )
    _loads(verb)
    _output(verb)

    verb = add("wheel", "the whole wheel of a sector, and its natural frequencies by nodal diameter")
    verb.set_defaults(run=run_wheel)
    verb.add_argument("model", help="sector about the axis z")
    verb.add_argument("--sectors", type=int, required=True, metavar="N", help="number of sectors of the wheel")
    verb.add_argument("--low", default="low", metavar="SET", help="side that, rotated by 2 pi/N, matches --high (default: low)")
    verb.add_argument("--high", default="high", metavar="SET", help="(default: high)")
    verb.add_argument("--frequencies", type=int, default=0, metavar="K", help="print the K lowest of each nodal diameter")
    verb.add_argument("--neighbours", action="append", default=[], metavar="NAME=SET,SET",
                      help="pair of a set of each sector and one of the next sector")  # fmt: skip
    verb.add_argument("--wave", action="append", default=[], metavar="NAME=SET:DIAMETERS",
                      help="load vectors NAME_cos and NAME_sin of a wave")  # fmt: skip
    verb.add_argument("--keep", help="reduce each nodal diameter separately, retaining these degrees of freedom of each sector")
    verb.add_argument("--diameter", type=int, metavar="H", help="with --keep: only the waves of this nodal diameter")
    _reduction(verb, 10, "of each nodal diameter; for double modes the number of pairs")
    _output(verb)

    verb = add("assemble", "combine parts to one model")
    verb.set_defaults(run=run_assemble)
    verb.add_argument("parts", nargs="+", metavar="NAME=FILE", help="a part and its model file; its sets become NAME_SET")
    verb.add_argument("--at", action="append", default=[], metavar="NAME=X,Y,Z", help="shift a part")
    verb.add_argument("--pair", action="append", default=[], metavar="NAME=SET,SET",
                      help="pair of coincident nodes of two sets, named NAME_1 and NAME_2")  # fmt: skip
    verb.add_argument("--surfaces", action="append", default=[], metavar="NAME=SET,SET",
                      help="contact between faces of two sets, whose meshes may differ: NAME.n, NAME.s, NAME.t")  # fmt: skip
    verb.add_argument("--within", type=float, default=0.0, metavar="M", help="largest distance of nodes of a pair, or of surfaces")
    verb.add_argument("--partial", action="store_true", help="nodes of both sets of a pair may meet none of the other set")
    _loads(verb)
    _output(verb)

    verb = add("laws", "one law for each point of a contact between surfaces, as groups of an input")
    verb.set_defaults(run=run_laws)
    verb.add_argument("model", help="model file, reduced to the directions of the contact, or whole")
    verb.add_argument("contact", metavar="NAME", help="name of the surfaces")
    verb.add_argument("--type", required=True, metavar="TYPE", help="type of the law: elastic_stop, jenkins, jenkins_2d, ...")
    verb.add_argument("--per-area", action="append", default=[], metavar="KEY=VALUE",
                      help="value for each unit of area: stiffness [N/m3], preload [N/m2], ...")  # fmt: skip
    verb.add_argument("--key", action="append", default=[], metavar="KEY=VALUE", help="value of each law: friction_coefficient=0.3")
    verb.add_argument("--along", default="", choices=CONTACT_DIRECTIONS,
                      help="direction of a law of one coordinate (default: s for friction, else n)")  # fmt: skip

    verb = add("reduce", "reduce a large model, with error estimate")
    verb.set_defaults(run=run_reduce)
    verb.add_argument("model", help="model file")
    verb.add_argument("--keep", required=True,
                      help="retained degrees of freedom and sets: n3.z,contact.z; of a pair its relative motion")  # fmt: skip
    _reduction(verb, 20, methods=reduction.METHODS)
    _output(verb)

    shells.add_verbs(top, verbs)
    return top


def _reduction(verb: Any, n_modes: int, more: str = "", methods: Any = reduction.MODAL) -> None:
    has_krylov = methods is reduction.METHODS
    default = "krylov with --up-to and without --modes, else free-interface" if has_krylov else methods[0]
    verb.add_argument("--modes", type=int, help=f"number of modes{' ' * bool(more)}{more} (default: {n_modes})")
    verb.add_argument("--method", choices=methods, help=f"(default: {default})")
    verb.add_argument("--up-to", type=float, metavar="RAD/S", help="highest frequency of use, up to which errors are reported")
    verb.add_argument("--no-error", action="store_true", help="do not compare with the full model")
    verb.add_argument("--tolerance", type=float, metavar="E",
                      help="largest error up to there: the modes are doubled until it is met"
                      + has_krylov * "; krylov: of each step (default: 1e-10)")  # fmt: skip
    verb.set_defaults(n_modes=n_modes, has_krylov=has_krylov)


def _loads(verb: Any) -> None:
    verb.add_argument("--load", action="append", default=[], metavar="NAME=LABEL:VALUE,...",
                      help="a load vector; for a set with a direction the value applies to each node")  # fmt: skip


def _output(verb: Any) -> None:
    verb.add_argument("-o", "--output", required=True, metavar="FILE", help="model file to write")
    verb.add_argument("--overwrite", action="store_true", help="replace an existing file")


def _check_output(options: Any) -> None:
    path = Path(options.output)
    if path.is_dir():
        raise ModelError(f"'{path}' is a folder")
    if path.exists() and not path.is_file():
        raise ModelError(f"'{path}' is not a regular file")
    if path.exists() and not options.overwrite:
        raise ModelError(f"file '{path}' exists; --overwrite replaces it")
    stem = vars(options).get("calculix")
    of_calculix = importing.calculix_files(stem).values() if stem else ()
    if path.exists() and (is_input(path, options) or any(file.exists() and path.samefile(file) for file in of_calculix)):
        raise ModelError(f"file '{path}' is an input of this command; give another --output")
    if not path.parent.is_dir():
        raise ModelError(f"file '{path}': there is no folder '{path.parent}'")


def _write(model: Structure, options: Any) -> None:
    path = Path(options.output)
    model.write(path)
    print(f"{path}: {model.n_dofs} degrees of freedom, {model.stiffness.nnz} entries of the stiffness")


def run_import(options: Any) -> int:
    sets = {}
    for text in options.set:
        name, numbers = _named("--set", text, "NAME=N,N,...")
        try:
            sets[name] = [int(number) for number in numbers.split(",")]
        except ValueError:
            raise ModelError(f"--set {text}: give NAME=N,N,..., with numbers of nodes") from None
    names = (*MATRICES, *importing.OPTIONS)
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    model = importing.import_structure(sets=sets, **given)
    for note in model.notes:
        print(note)
    _add_loads(model, options.load)
    model.validate()
    _write(model, options)
    return OK


def _add_loads(model: Structure, texts: list[str]) -> None:
    for text in texts:
        name, parts = _named("--load", text, "NAME=LABEL:VALUE,...")
        try:
            pairs = [part.rsplit(":", 1) for part in parts.split(",")]
            entries = [(dof, float(value)) for label, value in pairs for dof in model.dofs_of(label)]
        except ValueError:
            raise ModelError(f"--load {text}: give NAME=LABEL:VALUE,...") from None
        model.loads[name] = (np.array([dof for dof, _ in entries]), np.array([value for _, value in entries]))


def _named(option: str, text: str, form: str) -> tuple[str, str]:
    name, equals, rest = text.partition("=")
    if not (name and equals and rest):
        raise ModelError(f"{option} {text}: give {form}".strip())
    return name, rest


def run_fit(options: Any) -> int:
    if options.data.endswith(".nml") or options.input.lower().endswith((".csv", ".uff", ".unv")):
        options.input, options.data = options.data, options.input
    if bool(options.other) != bool(options.or_by):
        raise ModelError("--or names another input and --or-by, once or more, the parameters of that input: give both")
    by = {options.input: options.by, **({options.other: options.or_by} if options.other else {})}
    missing = [name for name in by if not Path(name).is_file()]
    if missing:
        raise ModelError(f"file '{missing[0]}' does not exist")
    if len(by) < 1 + bool(options.other):
        raise ModelError("--or names the same input; another law needs an input of its own")
    from nhbm.fitting import compare_fits, fit  # after what needs no packages
    from nhbm.model import Model
    from nhbm.universal_files import read_uff

    is_universal = options.data.lower().endswith((".uff", ".unv", ".uf"))
    if not is_universal and any(value is not None for value in (options.force, options.function, options.unit)):
        raise ModelError("--force, --function and --unit belong to universal files (.uff)")
    data = read_uff(options.data, options.force, options.function, options.unit) if is_universal else options.data
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotConverged)  # printed with the fit
        warnings.filterwarnings("ignore", ".* a model leaves out ", Implausible)  # a fit has frequencies of its own
        fits = {name: fit(Model.from_file(name), data, paths, options.of, order=options.order, tolerance=options.tolerance,
                          noise=options.noise, controlled=options.controlled) for name, paths in by.items()}  # fmt: skip
    found = fits[options.input]
    if options.other:
        compared = compare_fits(fits)
        for name, one in fits.items():
            print(f"{name}\n{one}\nprobability: {compared['probability'][name]:.3g}, bic {compared['bic'][name]:.5g}\n")
        chosen = compared["probability"].idxmax()
        print(f"more likely: {chosen}")
        found = fits[chosen]
    else:
        print(found)
    if options.write:
        found.model.to_file(options.write)
        print(f"wrote {options.write}")
    if options.picture:
        from matplotlib.figure import Figure

        found.plot(Figure(figsize=(6.4, 5.6), layout="constrained")).savefig(options.picture, dpi=150)
        print(f"wrote {options.picture}")
    return NOT_GOOD if found.message else OK


def run_info(options: Any) -> int:
    model = Structure.read(options.model)
    print(f"{options.model}: {model.source or 'of unknown origin'}; units {model.unit_system}")
    print(f"{model.n_dofs} degrees of freedom, {model.labels[0]} to {model.labels[-1]}; {len(model.node_numbers)} nodes, "
          f"{len(model.cell_types)} cells")  # fmt: skip
    for name, matrix in model.matrices().items():
        print(f"{name}: {matrix.nnz} entries, {matrix.nnz / model.n_dofs:.1f} a row")
    for name, nodes in model.sets.items():
        chosen = set(np.asarray(nodes).tolist())
        found = [d for node, d in zip(model.dof_node, model.dof_direction) if node in chosen]
        directions = ", ".join(f"{name}.{d}" for d in dict.fromkeys(found))
        print(f"set {name}: {len(nodes)} node{'s' * (len(nodes) != 1)}; {directions}")
    for name, contact in model.contacts.items():
        print(f"surfaces {name}: {len(contact.areas)} points, area {contact.areas.sum():.6g}")
    for name, (dofs, _) in model.loads.items():
        print(f"load {name}: {len(dofs)} entries")
    if model.recovery is not None:
        print(f"recovers {len(model.recovery.node)} degrees of freedom of the full model")
    return OK


def run_check(options: Any) -> int:
    findings = check(Structure.read(options.model))
    for finding in findings:
        print(("wrong: " if finding.is_bad else "") + finding.text)
    return NOT_GOOD if any(finding.is_bad for finding in findings) else OK


def run_example(options: Any) -> int:
    names = options.make.__code__.co_varnames[: len(options.make.__defaults__)]
    try:
        model = options.make(**{name: getattr(options, name) for name in names})
    except ModelError as error:
        name, must, rest = str(error).partition(" must ")
        raise ModelError(f"--{name.replace('_', '-')}{must}{rest}" if name in names else str(error)) from None
    for text in options.node_set:
        name, positions = _named("--node-set", text, "NAME=X,Y,Z")
        model.sets[name] = np.array([examples.nearest_node(model, _position(text, position)) for position in positions.split(";")])
    _add_loads(model, options.load)
    model.validate()
    _write(model, options)
    return OK


def _position(text: str, position: str) -> tuple[float, ...]:
    try:
        x, y, z = (float(number) for number in position.split(","))
    except ValueError:
        raise ModelError(f"{text}: a position has three coordinates, X,Y,Z") from None
    return x, y, z


def _two_sets(option: str, text: str) -> tuple[str, str, str]:
    name, sets = _named(option, text, "NAME=SET,SET")
    first, comma, second = sets.partition(",")
    if not comma:
        raise ModelError(f"{option} {text}: give NAME=SET,SET")
    return name, first, second


def _numbers(option: str, text: str, form: str) -> list[float]:
    """Numbers of an option such as `--disk`, as many as its form has."""
    try:
        values = [float(number) for number in text.split(",")]
    except ValueError:
        values = []
    if len(values) != len(form.split(",")):
        raise ModelError(f"{option} {text}: give {form}")
    return values


def run_rotor(options: Any) -> int:
    disks = [_numbers("--disk", text, "POSITION,MASS,DIAMETRAL,POLAR") for text in options.disk]
    bearings = [_numbers("--bearing", text, "POSITION,STIFFNESS,DAMPING") for text in options.bearing]
    model = rotors.rotor(options.length, options.diameter, options.n_elements, disks, bearings, options.speed)
    _add_loads(model, options.load)
    _write(model, options)
    return OK


def run_wheel(options: Any) -> int:
    n = options.sectors
    sector = cyclic.sector_of(Structure.read(options.model), n, options.low, options.high)
    if options.frequencies > 0:
        print("nodal diameters: lowest frequencies [rad/s]")
        for diameter in range(n // 2 + 1):
            shown = "  ".join(f"{w:.6g}" for w in cyclic.frequencies(sector, diameter, options.frequencies))
            print(f"{diameter:15d}: {shown}")
    neighbours = {name: (high, low) for name, high, low in (_two_sets("--neighbours", text) for text in options.neighbours)}
    waves = {name: wave for name, wave in map(_wave, options.wave)}
    if options.keep:
        h = options.diameter
        for name, wave in waves.items():
            if h is not None and (wave.diameter - h) % n and (wave.diameter + h) % n:
                raise ModelError(f"wave '{name}' of {wave.diameter} nodal diameters: the model has {h} alone (--diameter)")

        def reduced_wheel(n_modes: Any) -> Any:
            wanted = cyclic.Reduction(options.keep.split(","), n_modes, options.method, neighbours, waves)
            return cyclic.reduced_wheel(sector, wanted, options.diameter)

        model = _reduced(reduced_wheel, options)
        if model.recovery is None:
            print("the motion of all nodes is not stored: it would take more than 1.6 GB")
        _write(model, options)
        return OK
    if options.diameter is not None:
        raise ModelError("--diameter belongs to --keep")
    model = cyclic.wheel(sector)
    for name, (high, low) in neighbours.items():
        cyclic.add_neighbours(model, name, high, low, n)
    for name, wave in waves.items():
        cyclic.add_wave(model, name, wave.where, wave.diameter, n)
    model.validate()
    _write(model, options)
    return OK


def _wave(text: str) -> tuple[str, cyclic.Wave]:
    name, rest = _named("--wave", text, "NAME=SET:DIAMETERS")
    where, colon, diameter = rest.rpartition(":")
    if not (colon and diameter.isdigit()):
        raise ModelError(f"--wave {text}: give NAME=SET:DIAMETERS")
    return name, cyclic.Wave(where, int(diameter))


def run_assemble(options: Any) -> int:
    parts = {}
    for text in options.parts:
        name, path = _named("", text, "NAME=FILE")
        parts[name] = Structure.read(path)
    offsets = {name: _position(text, offset) for text in options.at for name, offset in [_named("--at", text, "NAME=X,Y,Z")]}
    model = assembly.assemble(parts, offsets)
    for text in options.pair:
        name, first, second = _two_sets("--pair", text)
        print(f"pair {name}: {assembly.add_pair(model, name, first, second, options.within, options.partial)} nodes")
    for text in options.surfaces:
        name, first, second = _two_sets("--surfaces", text)
        found = assembly.add_surfaces(model, name, first, second, options.within)
        apart = f", up to {found.gaps.max():.3g} apart" if found.gaps.max() > 0.0 else ""
        print(f"surfaces {name}: {len(found.areas)} points, area {found.areas.sum():.6g}{apart}")
    _add_loads(model, options.load)
    model.validate()
    _write(model, options)
    return OK


def run_laws(options: Any) -> int:
    values = []
    for option, texts in (("--per-area", options.per_area), ("--key", options.key)):
        given = {}
        for text in texts:
            key, value = _named(option, text, "KEY=VALUE")
            try:
                given[key] = float(value)
            except ValueError:
                raise ModelError(f"{option} {text}: '{value}' is no number") from None
        values.append(given)
    for law in surfaces.laws(Structure.read(options.model), options.contact, options.type, values[0], options.along, **values[1]):
        kind = law.pop("kind")
        texts = [f"{key} = {', '.join(map(repr, value)) if isinstance(value, list) else repr(value)}" for key, value in law.items()]
        print(f"&law type = '{kind}', {', '.join(texts)} /")
    return OK


def run_reduce(options: Any) -> int:
    model = Structure.read(options.model)

    def reduced_model(n_modes: Any) -> Any:
        reduced = reduction.reduce(
            model, options.keep.split(","), n_modes, options.method, options.up_to, options.tolerance or reduction.KRYLOV_TOLERANCE
        )
        return reduced, [(model, reduced)]

    _write(_reduced(reduced_model, options), options)
    return OK


def _reduced(reduce: Any, options: Any) -> Structure:
    """What `reduce` makes with a number of modes: a model, and pairs to compare. With more until errors are below the tolerance."""
    if options.method is None:
        is_krylov = options.has_krylov and options.up_to is not None and options.modes is None
        options.method = "krylov" if is_krylov else reduction.MODAL[0]
    if options.modes is None:
        options.modes = options.n_modes
    elif options.method == "krylov":
        raise ModelError("--modes belongs to the other methods: krylov takes as many shapes as --tolerance needs")
    if options.modes < 0:
        raise ModelError(f"--modes must be 0 or more, not {options.modes}")
    for name, value in (("--up-to", options.up_to), ("--tolerance", options.tolerance)):
        if value is not None and not 0 < value < np.inf:
            raise ModelError(f"{name} must be above 0, not {value}")
    if options.tolerance is not None and (options.up_to is None or options.no_error):
        raise ModelError("--tolerance needs --up-to, the highest frequency at which it holds, and no --no-error")
    n_modes, before = options.modes, 0
    while True:
        started = time.perf_counter()
        try:
            model, pairs = reduce(n_modes)
        except ModelError as error:
            if before == 0:
                raise
            raise ModelError(f"--tolerance {options.tolerance:g} is not met with {n_modes // 2} modes; with more {error}") from None
        print(f"reduced in {time.perf_counter() - started:.1f} s, {model.n_dofs} degrees of freedom")
        if options.no_error:
            return model
        largest = _print_errors(pairs, options.up_to)
        if options.tolerance is None or largest <= options.tolerance or options.method == "krylov":
            return model
        if model.n_dofs == before:
            raise ModelError(
                f"--tolerance {options.tolerance:g} is not met: the error is {largest:.1e}, and there are no more modes"
            )
        n_modes, before = max(1, 2 * n_modes), model.n_dofs


def _print_errors(pairs: list[tuple[Structure, Structure]], up_to: float | None) -> float:
    """The errors of reduced models, the largest of several at each frequency; returns the largest of all."""
    highest = up_to or max(_highest(reduced) for _, reduced in pairs)
    reports = [reduction.compare(model, reduced, reduction.band(reduced, highest)) for model, reduced in pairs]
    n = len(reduction.BAND)
    for i, w in enumerate(reports[0].frequencies[:n]):
        print(f"error of the flexibility at {w:.6g} rad/s: {max(report.errors[i] for report in reports):.1e}")
    at_resonances = max(report.errors[n:].max(initial=0.0) for report in reports)
    count = sum(report.resonances for report in reports)
    if count:
        off = max(report.resonance_error for report in reports)
        print(f"error of the flexibility at resonances: {at_resonances:.1e}; of the {count} frequencies up to there: {off:.1e}")
    print(f"compared with the full model in {sum(report.seconds for report in reports):.1f} s")
    return max(report.errors.max() for report in reports)


def _highest(reduced: Structure) -> float:
    """Half of the highest frequency among the modes of the reduced model."""
    values, _ = dense_modes(symmetric_part(reduced.stiffness), reduced.mass)
    n_retained = sum(label[0] != "q" for label in reduced.labels)
    return 0.5 * float(np.sqrt(max(values[max(0, len(values) - n_retained - 1)], 0.0)))


if __name__ == "__main__":
    sys.exit(main_in_child_process())
