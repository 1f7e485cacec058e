"""The verbs of the command `nhbm-post`: each one receives the parsed arguments and prints or draws."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np

from . import report
from .bench import Bench, read_reference
from .errors import UsageError
from . import integration
from .measure import Measure
from .outcome import CONVERGED, words
from .reader import QUANTITIES, Results
from .text import counted, list_text, number_text

_MOST_MOTIONS = 10  # that a picture over time can tell apart

# matplotlib takes a second to load, so only the verbs that draw import nhbm_post.draw.


def info(arguments):
    if integration.is_record(arguments.file):
        print(integration.info(arguments.file))
        return
    with Results(arguments.file) as results:
        print(report.info(results, arguments.dof, arguments.points))


def value(arguments):
    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        dof = arguments.dof or results.default_dof(arguments.quantity)
        print(report.value(results, point, dof, arguments.tuple, arguments.quantity, arguments.unconverged))


def correction(arguments):
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


def spectrum(arguments):
    from . import draw

    if integration.is_record(arguments.file):
        series, title, in_hertz = _series_of_record(arguments)
    else:
        with Results(arguments.file) as results:
            point = results.point(arguments.point, dict(arguments.at))
            series, in_hertz = _series(results, point, arguments.dof, arguments), results.in_hertz
            title = _origin(results, point, arguments.quantity)
    fig = draw.draw_spectrum(
        series,
        title=title,
        form=arguments.form,
        over=arguments.over,
        decades=arguments.decades,
        is_normalised=not arguments.absolute,
        in_hertz=in_hertz,
    )
    _save(fig, arguments)


def report_page(arguments):
    from .page import write_page

    output = arguments.output or arguments.file.with_suffix(".html")
    if output.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"cannot write a page to '{output}': the name must end in .html")
    with Results(arguments.file) as results:
        for note in write_page(results, output, arguments.model):
            print(note)
    print(f"wrote {output}")


def orbit(arguments):
    from . import draw

    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        if arguments.section > results.n_tones:
            raise UsageError(f"{results.path}: no tone {arguments.section}; tones: 1 to {results.n_tones}")
        x = _series(results, point, arguments.dof, arguments)
        y = _series(results, point, arguments.other, arguments) if arguments.other else x.velocity()
        about = _origin(results, point, arguments.quantity)
    _save(draw.draw_orbit(x, y, tone=arguments.section - 1, about=about), arguments)


def surface(arguments):
    from . import draw

    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        series = _series(results, point, arguments.dof, arguments)
        fig = draw.draw_surface(series, view=arguments.view, about=_origin(results, point, arguments.quantity))
    _save(fig, arguments)


def waterfall(arguments):
    from . import draw

    with Results(arguments.file) as results:
        fig = draw.draw_waterfall(
            results,
            arguments.dof,
            view=arguments.command,
            quantity=arguments.quantity,
            over=arguments.over,
            where=dict(arguments.where),
            decades=arguments.decades,
        )
    _save(fig, arguments)


def animate(arguments):
    from . import draw
    from .structure import has_model, motions, structure_of

    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        about = _origin(results, point, arguments.quantity)
        view = arguments.view or ("structure" if has_model(results) else "hypertime")
        periods = _PERIODS_OF_A_TORUS if view == "hypertime" and results.n_tones > 1 else 1
        slowest = float(np.abs(results.frequency(point)).min())
        end = arguments.t_from + 2.0 * np.pi * periods / slowest if arguments.t_to is None else arguments.t_to
        times = np.linspace(arguments.t_from, _after(arguments.t_from, end), arguments.frames, endpoint=False)
        if view == "structure":
            structure = structure_of(results, point, arguments.model)
            _, frequencies, coefficients = motions(results, structure, point, arguments.unconverged)
            moments = [(coefficients * np.exp(1j * frequencies * t)).real.sum(axis=1) for t in times]
            fig, update = draw.structure_in_motion(structure, [structure.displacement(x) for x in moments], times, about)
        else:
            fig, update = draw.hypertime_in_motion(_series(results, point, arguments.dof, arguments), times, about)
    draw.relabel(fig, dict(arguments.labels))
    output = arguments.output or arguments.file.with_name(f"{arguments.file.stem}_animate.gif")
    print(f"wrote {draw.save_animation(fig, update, len(times), output, arguments.fps, arguments.dpi)}")


def response(arguments):
    _draw_response(arguments, lambda results: _measure(arguments, results), arguments.over)


def peaks(arguments):
    with ExitStack() as stack:
        files = [(label or path.stem, stack.enter_context(Results(path))) for label, path in arguments.files]
        print(report.peaks(files, _measure(arguments, files[0][1]), arguments.dof))


def backbone(arguments):
    def measure(results):
        if arguments.over is None and not any(path in results.swept for path in _BACKBONES):
            raise UsageError(
                f"{results.path}: neither {' nor '.join(_BACKBONES)} is swept; give --over (swept: {list_text(results.swept)}, "
                "or amplitude)"
            )
        return Measure("frequency", tone=_tone(arguments, results))

    over = arguments.over
    if over is None:
        with Results(arguments.file) as results:
            over = next((path for path in _BACKBONES if path in results.swept), None)
    _draw_response(arguments, measure, over)


_PERIODS_OF_A_TORUS = 6  # of the slowest tone, in an animation
_BACKBONES = ("normal_mode%amplitude", "normal_mode%energy")


def _draw_response(arguments, measure, over):
    from . import draw

    with ExitStack() as stack:
        files = [(label or path.stem, stack.enter_context(Results(path))) for label, path in arguments.files]
        (label, results), others = files[0], files[1:]
        if arguments.output and arguments.output.suffix.lower() == ".csv":
            draw.write_response(files, arguments.dof, arguments.output, measure=measure(results), over=over,
                                where=dict(arguments.where), n_curves=arguments.curves)  # fmt: skip
            print(f"wrote {arguments.output}")
            return
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


def map(arguments):
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


def multipliers(arguments):
    from . import draw

    with Results(arguments.file) as results:
        fig = draw.draw_multipliers(results, where=dict(arguments.where))
    _save(fig, arguments)


def _measure(arguments, results: Results):
    """The quantity requested by --measure, --tuple, --tone and --of."""
    name = arguments.measure or ("harmonic" if arguments.tuple else "frequency" if arguments.tone else "peak")
    if (name == "harmonic") != (arguments.tuple is not None):
        raise UsageError("--measure harmonic and --tuple belong together")
    if arguments.tone and name != "frequency":
        raise UsageError("--tone belongs to --measure frequency")
    if arguments.tuple and len(arguments.tuple) != results.n_tones:
        entries = counted(len(arguments.tuple), "entry", "entries")
        raise UsageError(f"--tuple has {entries}; {results.path} has {counted(results.n_tones, 'tone')}")
    tone = _tone(arguments, results) if name == "frequency" else 0
    return Measure(name, arguments.tuple, tone, arguments.quantity)


def _tone(arguments, results: Results) -> int:
    """Number of the tone, from 0: the given one, otherwise the first unknown one, otherwise the first."""
    if arguments.tone is not None:
        if arguments.tone > results.n_tones:
            raise UsageError(f"{results.path}: no tone {arguments.tone}; tones: 1 to {results.n_tones}")
        return arguments.tone - 1
    unknown = results.unknown_tones()
    return int(unknown[0]) if unknown.size else 0




def rotor(arguments):
    from . import draw

    with Results(arguments.file) as results:
        point = 0 if arguments.view == "speeds" else results.point(arguments.point, dict(arguments.at))
        fig = draw.draw_rotor(results, point, arguments.view)
    _save(fig, arguments, arguments.view)


def deflection(arguments):
    from . import draw
    from .structure import harmonic_of, motions, structure_of

    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        structure = structure_of(results, point, arguments.model)
        tuples, frequencies, coefficients = motions(results, structure, point, arguments.unconverged)
        about = _origin(results, point, "motion")
        factor, unit = results.frequency_scale()
    if arguments.time is not None:
        motion = (coefficients * np.exp(1j * frequencies * arguments.time)).real.sum(axis=1)
        field = structure.displacement(motion)
        sizes = ("Displacement", np.linalg.norm(field, axis=1))
        fig = draw.draw_deflection(structure, field, sizes, f"Motion at {arguments.time:g} s", about)
    else:
        h = harmonic_of(tuples, coefficients, arguments.tuple)
        shape = structure.displacement(coefficients[:, h].real) + 1j * structure.displacement(coefficients[:, h].imag)
        largest = shape.ravel()[np.argmax(np.abs(shape))]
        moment = (shape * np.exp(-1j * np.angle(largest))).real
        words = f"Harmonic ({','.join(str(k) for k in tuples[h])}), {factor * abs(frequencies[h]):.6g} {unit}"
        sizes = ("Amplitude", np.linalg.norm(np.abs(shape), axis=1))
        fig = draw.draw_deflection(structure, moment, sizes, words, about)
    _save(fig, arguments)


def contact(arguments):
    from . import draw
    from .contact import UNITS, Motion, chosen, contacts, history, summary
    from .structure import structure_of

    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        structure = structure_of(results, point, arguments.model)
        found = chosen(contacts(results, structure, point), arguments.law, results)
        motion = Motion(results, point, arguments.unconverged)
        coordinates, about = structure.points[found.nodes] if found.table is None else None, _origin(results, point, "motion")
        arguments.view = arguments.view or ("patch" if found.n > 1 else "time")
        if arguments.view == "patch":
            values = summary(found, motion, results.power_laws(point))
            ends = {name: [number_text(value.min()), number_text(value.max())] for name, value in values.items()}
            spans = {name: " to ".join(dict.fromkeys(both)) for name, both in ends.items()}
            ranges = [f"{name} {span} {UNITS[name]}".removesuffix(" 1") for name, span in spans.items()]
            print(f"{found.label}, {found.counted}: {', '.join(ranges)}")
            fig = draw.draw_patch(found, values, coordinates, about)
        else:
            end = arguments.t_from + motion.period if arguments.t_to is None else arguments.t_to
            times = np.linspace(arguments.t_from, _after(arguments.t_from, end), 601)
            found_history = history(found, motion, times)
            fig = draw.draw_contact_time(found, found_history, times, coordinates, structure.has_axis, about)
    _save(fig, arguments, arguments.view)


def _after(start: float, end: float) -> float:
    if not end > start:
        raise UsageError("the motion must end after it begins: --to above --from")
    return end


def vtk(arguments):
    from .contact import Motion, contacts, moments, shares
    from .structure import motions, structure_of, write_harmonics, write_motion

    with Results(arguments.file) as results:
        point = results.point(arguments.point, dict(arguments.at))
        structure = structure_of(results, point, arguments.model)
        tuples, frequencies, coefficients = motions(results, structure, point, arguments.unconverged)
        forces = {dof: results.series(point, dof, "force", arguments.unconverged) for dof in results.labels("force")}
        slowest = float(np.abs(results.frequency(point)).min())
        end = arguments.t_to if arguments.t_to is not None else arguments.t_from + 2 * np.pi / slowest
        times = np.linspace(arguments.t_from, _after(arguments.t_from, end), arguments.frames, endpoint=False)
        found = contacts(results, structure, point)
        motion = Motion(results, point, arguments.unconverged) if found else None
        at_nodes = shares(found, motion, results.power_laws(point), structure) if found else {}
        over_time = moments(found, motion, times, structure)
    for table in (contact for contact in found if contact.table is not None):
        print(f"'{table.label}': the contacts of {table.kind} stand at no node, and in no file; nhbm-post contact draws them")
    stem = arguments.output or arguments.file.with_suffix("")
    path = stem.with_name(f"{stem.name}_harmonics.vtu")
    written = write_harmonics(structure, tuples, coefficients, path, arguments.tuples, arguments.harmonics, at_nodes)
    print(f"{path}: {len(written)} harmonics, {list_text([','.join(str(k) for k in j) for j in written])}")
    if arguments.frames == 0:
        return
    path = stem.with_name(f"{stem.name}_motion.pvd")
    write_motion(structure, frequencies, coefficients, path, times, forces, over_time)
    print(f"{path}: {len(times)} moments from {arguments.t_from:g} s to {end:g} s")


def _write_record(arguments):
    """Writes the times and displacements of a record as they are."""
    from .draw.time_history import write_table

    if arguments.overlay or arguments.integration or arguments.samples:
        raise UsageError("a .csv of a record holds its own times: leave --overlay, --integration and --samples out")
    series, _, _ = _series_of_record(arguments)
    _, t, x = integration.read_displacement(arguments.file, series.label)
    low = -np.inf if arguments.t_from is None else arguments.t_from
    inside = (t >= low) & (t <= (np.inf if arguments.t_to is None else arguments.t_to))
    if not inside.any():
        raise UsageError(f"the record has no times there; it is from {t[0]:g} to {t[-1]:g} s")
    print(f"wrote {write_table([('t', 's'), (series.label, series.units)], [t[inside], x[inside]], arguments.output)}")


def time(arguments):
    from . import draw
    from .draw.time_history import Record, read_record, write_time

    at = dict(arguments.at)
    if integration.is_record(arguments.file):
        if arguments.output and arguments.output.suffix.lower() == ".csv":
            _write_record(arguments)
            return
        series, title, _ = _series_of_record(arguments)
        dof, curves = series.label, [(f"its {series.n_harmonics} harmonics", series)]
        arguments.integration = arguments.integration or ("", arguments.file)
    else:
        with Results(arguments.file) as results:
            if arguments.point is not None:
                points = [results.point(number) for number in arguments.point]
            elif at:
                points = results.select(at)
            else:
                points = [results.point()]
            if len(points) > _MOST_MOTIONS and not (arguments.output and arguments.output.suffix.lower() == ".csv"):
                text = f"{len(points)} points are chosen, of which a picture shows {_MOST_MOTIONS} at most: choose fewer by --point"
                raise UsageError(f"{text}, or by an --at for each parameter")
            dof = arguments.dof or results.default_dof(arguments.quantity)
            curves = [(_legend(results, point, points), _series(results, point, dof, arguments)) for point in points]
            outcome = results.warning(points[0]) if len(points) == 1 else ""
            title = ", ".join(part for part in (results.title, *_common_parameters(results, points), outcome) if part)
    if arguments.output and arguments.output.suffix.lower() == ".csv":
        if arguments.overlay or arguments.integration:
            raise UsageError("a .csv holds the motions of one result file: leave --overlay and --integration out")
        names = [dof if len(points) == 1 else f"{dof} at point {point}" for point in points]
        columns = [(name, series) for name, (_, series) in zip(names, curves)]
        print(f"wrote {write_time(columns, arguments.output, arguments.t_from, arguments.t_to, arguments.samples)}")
        return
    references = []
    if arguments.integration:
        label, path = arguments.integration
        if arguments.quantity == "force":
            raise UsageError("--integration compares motions: a record has forces by coordinate of a law, not by dof")
        method, t, x = integration.read_displacement(path, dof)
        references.append(Record(label or f"time integration, {method}", t, x))
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
        has_difference=arguments.difference or bool(arguments.integration),
    )
    _save(fig, arguments)


def work_precision(arguments):
    from . import draw

    bench = Bench(arguments.file)
    _save(draw.draw_work_precision(bench, _errors(bench, arguments), part=arguments.part), arguments)


def convergence(arguments):
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


def cost(arguments):
    from . import draw

    fig, exponents = draw.draw_cost(Bench(arguments.file), part=arguments.part)
    for curve, rate in exponents:
        print(f"{curve.label}: " + (f"time ~ {rate.plain('unknowns')}" if rate else f"no exponent, {rate.reason}"))
    _save(fig, arguments)


def bench(arguments):
    from . import draw

    fig, exponents, notes = draw.draw_bench(Bench(arguments.file, *arguments.also), arguments.over)
    for kernel, rate in exponents:
        print(f"{kernel}: " + (f"time ~ {rate.plain('n')}" if rate else f"no exponent, {rate.reason}"))
    for note in notes:
        print(note)
    _save(fig, arguments)


def _series_of_record(arguments):
    """Harmonics of a record of time integration, a title, and whether it is in hertz."""
    if arguments.point is not None or arguments.at or arguments.quantity != "motion":
        raise UsageError(f"{arguments.file}: a record of time integration holds one motion: leave --point, --at and --of out")
    return integration.read_series(arguments.file, arguments.dof)


def _series(results: Results, point: int, dof: str | None, arguments):
    """Harmonics for a picture, with zeros for rounding errors."""
    series = results.series(point, dof, arguments.quantity, arguments.unconverged)
    return series.without_noise(results.noise(point, arguments.quantity, series.units))


def _legend(results: Results, point: int, points: list[int]) -> str:
    """The values in which the point differs from the others in the picture, or the method if it is the only one."""
    series_text = "time integration" if results.status_name(point) == "integrated" else "harmonic balance"
    differing = [
        results.shown(p).text(point) for p in results.parameters.values() if len({str(v) for v in p.values[points]}) > 1
    ]
    if len(points) == 1:
        return f"{series_text}, {int(results.per_point('n_harmonics')[point])} harmonics"
    return _with_status(f"{series_text}, " + (", ".join(differing) or f"point {point}"), results, point)


def _with_status(label: str, results: Results, point: int) -> str:
    """A legend that contains the status of the point, unless it has converged."""
    return label if results.status[point] == CONVERGED else f"{label} ({words(results.status_name(point))})"


def _common_parameters(results: Results, points: list[int]) -> list[str]:
    return [
        results.shown(p).text(points[0]) for p in results.parameters.values() if len({str(v) for v in p.values[points]}) == 1
    ]


def _quantity_words(quantity: str) -> str:
    return "" if quantity == "motion" else QUANTITIES[quantity].words


def _origin(results: Results, point: int, quantity: str) -> str:
    parts = [results.title, results.point_text(point), _quantity_words(quantity)]
    if results.warning(point):
        parts.append(results.warning(point))
    return ", ".join(part for part in parts if part)


def _save(fig, arguments, *parts: str) -> None:
    """Writes the picture under the requested name, by default that of the file, the command and `parts` of it."""
    from . import draw

    name = "_".join([arguments.file.stem, arguments.command, *parts])
    is_paper = "paper" in arguments.style
    output = arguments.output or arguments.file.with_name(f"{name}.{'pdf' if is_paper else 'png'}")
    draw.relabel(fig, dict(arguments.labels))
    if is_paper:
        print(f"caption: {fig.nhbm_caption}")
    print(f"wrote {draw.save(fig, output, arguments.dpi, has_numbers=arguments.command in ('response', 'time'))}")
