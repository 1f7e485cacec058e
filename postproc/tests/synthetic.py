"""Writes small result files by docs/user/schema.md with h5py, dimension scales attached, for the tests."""

import itertools

import h5py
import numpy as np

STATUS_WORDS = (
    "pending converged stalled out_of_budget singular not_finite failed truncated aliased penetrating "
    "collapsed no_motion crashed diverged locked timed_out impact unused integrated subharmonic broadband multiple_attractors "
    "law_undefined"
)
CONVENTION = (
    "x(t) = sum over harmonics h of [ cos_h cos(j_h . omega t) + sin_h sin(j_h . omega t) ]; "
    "one-sided peak amplitude sqrt(cos_h**2 + sin_h**2)"
)


def box(n_tones, order):
    """Tuples with |j_m| <= order whose first non-zero entry is positive, and zero."""
    tuples = [
        j
        for j in itertools.product(range(-order, order + 1), repeat=n_tones)
        if next((k for k in j if k != 0), 0) >= 0
    ]
    return np.array(sorted(tuples, key=lambda j: (sum(abs(k) for k in j), j)), dtype=np.int32)


def write_results(
    path,
    tuples,
    frequency,
    coefficients,
    *,
    dofs=("v3",),
    law_dofs=("v3",),
    corrected=None,
    force=None,
    status=None,
    messages=None,
    parameters=None,
    samples=None,
    corrected_samples=None,
    force_samples=None,
    units="m",
    title="synthetic",
    schema_version=1,
    strings="variable",
    message_layout="chars",
    dof_units=None,
    penetration=None,
    input_groups="",
    laws=(),
    power=(),
):
    """Writes a file; `coefficients` (point, dof, harmonic, 2), `parameters` {name: (path, units, values)}.

    `samples` etc. have the shape (point, law_dof, ..., tau_2, tau_1). `strings` chooses `variable`, or
    `fixed` padded by blanks as Fortran does; `message_layout` chooses `fixed` strings or `chars`, the
    netCDF way. `dof_units` gives each degree of freedom its own unit. `input_groups`
    is inserted before `&output` in the stored input.
    """
    tuples = np.asarray(tuples, dtype=np.int32)
    frequency = np.asarray(frequency, dtype=float)
    coefficients = np.asarray(coefficients, dtype=float)
    n_points, n_tones = frequency.shape
    status = np.ones(n_points, np.int32) if status is None else np.asarray(status, np.int32)
    law_rows = [list(dofs).index(label) for label in law_dofs]
    corrected = coefficients[:, law_rows] if corrected is None else corrected
    force = np.zeros_like(coefficients[:, law_rows]) if force is None else force

    with h5py.File(path, "w") as file:
        attributes = dict(
            program_version="0.1.0",
            git_commit="unknown",
            created_utc="2024-01-02T03:04:05Z",
            title=title,
            amplitude_convention=CONVENTION,
        )
        for name, value in attributes.items():
            file.attrs[name] = np.bytes_(value) if strings == "fixed" else value
        file.attrs["schema_version"] = np.int32(schema_version)
        file.attrs["n_ranks"] = np.int32(2)

        def add(name, values, dims=(), units="1", long_name="", **extra):
            dataset = file.create_dataset(name, data=values)
            dataset.attrs["units"] = np.bytes_(units)
            dataset.attrs["long_name"] = np.bytes_(long_name or name.replace("_", " "))
            for key, value in extra.items():
                dataset.attrs[key] = np.bytes_(value) if isinstance(value, str) else value
            for axis, dim in enumerate(dims):
                dataset.dims[axis].attach_scale(file[dim])
            return dataset

        def text_array(values, size=16):
            if strings == "fixed":
                return np.array([str(v).ljust(size).encode() for v in values], f"S{size}")
            return np.array([str(v) for v in values], dtype=h5py.string_dtype())

        def scale(name, values, units="1"):
            add(name, values, (), units).make_scale(name)

        scale("point", np.arange(n_points, dtype=np.int32))
        scale("tone", np.arange(1, n_tones + 1, dtype=np.int32))
        scale("harmonic", np.arange(len(tuples), dtype=np.int32))
        scale("dof", text_array(dofs))
        scale("law_dof", text_array(law_dofs))
        scale("component", text_array(["cos", "sin"]))

        add("tuple", tuples, ("harmonic", "tone"), long_name="integer tuple of each harmonic")
        for name, (parameter, parameter_units, values) in (parameters or {}).items():
            is_text = isinstance(values[0], str)
            data = text_array(values) if is_text else np.asarray(values, float)
            add(name, data, ("point",), parameter_units, parameter=parameter)
        add(
            "status",
            status,
            ("point",),
            long_name="outcome",
            flag_values=np.arange(len(STATUS_WORDS.split()), dtype=np.int32),
            flag_meanings=STATUS_WORDS,
        )
        messages = [m.encode() for m in (messages or [""] * n_points)]
        if message_layout == "chars":
            size = file.create_dataset("message_byte", data=np.arange(200, dtype=np.int32))
            size.make_scale(f"This is a netCDF dimension but not a netCDF variable.{200:10d}")
            chars = np.array(messages, "S400").view("S1").reshape(n_points, 400)
            add("message", chars, ("point", "message_byte"), _Encoding="utf-8")
        else:
            add("message", np.array(messages, "S400"), ("point",))
        is_done = status != 0
        add("iterations", np.where(is_done, 5 + np.arange(n_points), 0).astype(np.int32), ("point",))
        add("evaluations", np.where(is_done, 9 + np.arange(n_points), 0).astype(np.int32), ("point",))
        add("residual", np.where(is_done, 1e-11, np.nan), ("point",))
        add("solve_seconds", np.where(is_done, 0.25, np.nan), ("point",), "s")
        add("rank", np.zeros(n_points, np.int32), ("point",))
        add("n_harmonics", np.isfinite(coefficients[:, 0, :, 0]).sum(axis=1).astype(np.int32), ("point",))
        add("frequency", frequency, ("point", "tone"), "rad/s")
        own_units = {} if dof_units is None else {"dof_units": " ".join(dof_units)}
        add("coefficients", coefficients, ("point", "dof", "harmonic", "component"), units, **own_units)
        add("force_coefficients", force, ("point", "law_dof", "harmonic", "component"), "N")
        add("corrected_coefficients", corrected, ("point", "law_dof", "harmonic", "component"), units)
        add(
            "penetration",
            np.zeros(n_points) if penetration is None else np.asarray(penetration),
            ("point",),
            units,
        )
        if laws:
            scale("law", text_array(laws))
            add("power_laws", np.tile(np.asarray(power, float), (n_points, 1)), ("point", "law"), "W")
        surfaces = dict(
            displacement_samples=samples, corrected_samples=corrected_samples, force_samples=force_samples
        )
        if samples is not None:
            sizes = np.shape(samples)[2:][::-1]
            for m, n in enumerate(sizes, start=1):
                scale(f"tau_{m}", 2.0 * np.pi * np.arange(n) / n, "rad")
            axes = tuple(f"tau_{m}" for m in range(n_tones, 0, -1))
            for name, values in surfaces.items():
                if values is not None:
                    add(name, values, ("point", "law_dof", *axes), "N" if name.startswith("force") else units)
        for name in ("input_text", "input_complete"):
            text = f"{input_groups}&output title='{title}' /"
            file.create_dataset(name, data=np.bytes_(text) if strings == "fixed" else text)
    return path
