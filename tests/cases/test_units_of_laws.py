"""Every law in other units: lengths times 1e-9 and forces times 1e6 change no iteration and no digit beyond rounding.

With powers of two near these nothing is rounded, and no bit may change. Time keeps its unit, so a key in N s/m is multiplied like
one in N/m.
"""

import re

import numpy as np
import pytest

from program import read, solve

LENGTH, FORCE = 1e-9, 1e6
EXACT_LENGTH, EXACT_FORCE = 2.0**-30, 2.0**20
SAME = 1e-12

# Keys of models with four degrees of freedom as (value, power of force, power of length).
F, L = (1, 0), (0, 1)
STIFFNESS = (1, -1)
LAWS = {
    "annular_clearance": {
        "dofs": "'x1', 'x2'",
        "stiffness": (2.0, *STIFFNESS),
        "clearance": (0.5, *L),
        "friction_coefficient": 0.1,
    },
    "blade_contact": {
        "dofs": "'x1', 'x2', 'x3', 'x4'",
        "n_diameters": 1,
        "n_blades": 5,
        "gaps": (0.5, *L),
        "stiffness": (0.5, *STIFFNESS),
    },
    "bouc_wen": {
        "dof": "'x1'",
        "stiffness": (1.0, *STIFFNESS),
        "yield_displacement": (0.2, *L),
        "exponent": 2.0,
        "beta": 0.7,
    },
    "contact_table": {
        "dofs": "'x1', 'x2'",
        "n_contacts": 2,
        "shapes": "1.0, -1.0, -1.0, 0.5",
        "gaps": ((0.2, 0.3), *L),
        "stiffness": (5.0, *STIFFNESS),
    },
    "coulomb_rigid": {"dof": "'x1'", "limit": (0.1, *F)},
    "coulomb_tanh": {"dof": "'x1'", "limit": (0.1, *F), "velocity": (0.2, *L)},
    "cubic_damping": {"dofs": "'x1'", "coefficient": (0.3, 1, -3)},
    "cubic_spring": {"dof": "'x1'", "stiffness": (1.0, 1, -3)},
    "elastic_stop": {"dof": "'x1'", "stiffness": (5.0, *STIFFNESS), "gap": (0.3, *L)},
    "electrostatic": {
        "dof": "'x1'",
        "coefficient": (0.5, 1, 2),
        "gap": (3.0, *L),
        "voltage": 1.2,
        "tuple": 2,
        "voltage_cos": 0.7,
    },
    "hertz": {"dof": "'x1'", "stiffness": (5.0, 1, -1.5), "gap": (0.1, *L), "dissipation": (0.2, 0, -1)},
    "iwan": {"dof": "'x1'", "stiffness": ((0.5, 0.5), *STIFFNESS), "limit": ((0.1, 0.2), *F)},
    "jenkins": {"dof": "'x1'", "stiffness": (1.0, *STIFFNESS), "limit": (0.2, *F)},
    "jenkins_2d": {"dof": "'x1'", "second_dofs": "'x2'", "stiffness": (1.0, *STIFFNESS), "limit": (0.2, *F)},
    "parametric": {"dof": "'x1'", "tuple": "1, 1", "stiffness_cos": (0.5, *STIFFNESS), "damping_sin": (0.1, *STIFFNESS)},
    "piecewise_linear": {
        "dof": "'x1'",
        "breakpoints": ((-0.2, 0.3), *L),
        "slopes": ((2.0, 0.5, 3.0), *STIFFNESS),
    },
    "polynomial": {"dof": "'x1'", "stiffness": "{k1}, {k2}", "damping": "{d1}, {d2}"},
    "polynomial_coupled": {
        "dofs": "'x1', 'x2'",
        "coefficients": ((0.5, 0.5), 1, -3),
        "acts_on": "'x1', 'x2'",
        "displacement_exponents": "1, 2, 2, 1",
    },
    "quadratic_damping": {"dof": "'x1'", "coefficient": (0.5, 1, -2)},
    "rigid_wall": {"dof": "'x1'", "gap": (0.3, *L)},
    "rolling_bearing": {
        "dof": "'x1'",
        "second_dofs": "'x2'",
        "tuple": 2,
        "n_balls": 5,
        "stiffness": (0.5, 1, -1.5),
        "clearance": (-0.3, *L),
    },
    "short_bearing": {
        "dof": "'x1'",
        "second_dofs": "'x2'",
        "viscosity": (0.02, 1, -2),
        "radius": (1.0, *L),
        "length": (1.0, *L),
        "clearance": (4.0, *L),
        "rotor_speed": 0.5,
    },
    "stribeck": {
        "dof": "'x1'",
        "limit": (0.1, *F),
        "static_limit": (0.15, *F),
        "stribeck_velocity": (0.4, *L),
        "velocity": (0.2, *L),
        "belt_velocity": (0.1, *L),
    },
    "tabulated": {"dof": "'x1'", "displacements": ((-1.0, 0.0, 1.0), *L), "forces": ((-2.0, 0.0, 0.5), *F)},
    "van_der_pol": {"dof": "'x1'", "strength": (0.1, *STIFFNESS), "threshold": (0.5, *L)},
}
# Laws of a power of each coefficient of their own.
POWERS = {"k1": (0.5, 1, -1), "k2": (0.3, 1, -2), "d1": (0.1, 1, -1), "d2": (0.1, 1, -2)}
# A power of a length: the library of C rounds other lengths otherwise, powers of two apart as well.
ROUNDED = {"hertz", "rolling_bearing"}
WITHOUT_UNITS = {"user"}  # only its author knows the units of its parameters


def number(value, force_power, length_power, force, length):
    return repr(value * force**force_power * length**length_power)


def text_of(value, force, length):
    """A key's value; tuples contain powers of force and length, texts may name entries of POWERS."""
    if isinstance(value, str):
        names = {name: number(*entry, force, length) for name, entry in POWERS.items()}
        return value.format(**names) if "{" in value else value
    if not isinstance(value, tuple):
        return repr(value)
    values = value[0] if isinstance(value[0], tuple) else (value[0],)
    return ", ".join(number(one, *value[1:], force, length) for one in values)


def model(law, method, force=1.0, length=1.0):
    keys = ", ".join(f"{key} = {text_of(value, force, length)}" for key, value in LAWS[law].items())
    scale = force / length
    mass = [repr(entry * scale) for entry in (1.0, 0.8, 1.0, 1.0)]
    stiffness = [[2.0, -0.7, 0.0, 0.0], [-0.7, 1.5, -0.2, 0.0], [0.0, -0.2, 3.0, -0.1], [0.0, 0.0, -0.1, 2.5]]
    entries = [repr(entry * scale) for row in stiffness for entry in row]
    return f"""
&structure type = 'matrices', n_dofs = 4, mass = {", ".join(mass)}, stiffness = {", ".join(entries)}, damping_mass = 0.3 /
&tones frequency = 0.7, 1.1313708498984762 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, 0, cos = {0.6 * force!r} /
&load dof = 'x2', tuple = 0, 1, cos = {0.4 * force!r}, sin = {0.2 * force!r} /
&law type = '{law}', {keys} /
&solver method = '{method}' /
&error_estimate is_on = .false. /
"""


NAMES = ("coefficients", "force_coefficients", "iterations", "evaluations", "fallback")


# A smooth law, a contact and one with memory represent the others, which do not depend on the method.
BY_BROYDEN = ("cubic_spring", "elastic_stop", "jenkins")
PLAIN = (*BY_BROYDEN, "jenkins_2d", "polynomial", "rigid_wall", "short_bearing")  # and these for every kind of key
METHODS = [pytest.param(law, "newton", marks=[pytest.mark.long] * (law not in PLAIN)) for law in LAWS]
METHODS += [pytest.param(law, "broyden", marks=[pytest.mark.long] * (law not in BY_BROYDEN)) for law in LAWS]


@pytest.mark.parametrize(("law", "method"), METHODS)
def test_other_units_change_nothing(law, method, tmp_path):
    plain = read(solve(model(law, method), tmp_path, name="plain"), *NAMES)
    scaled = read(solve(model(law, method, FORCE, LENGTH), tmp_path, name="scaled"), *NAMES)
    for unit, own, other in zip((LENGTH, FORCE), plain, scaled):
        assert np.any(own)
        assert np.max(np.abs(other / unit - own)) <= SAME * np.max(np.abs(own))
    assert [int(value[0]) for value in scaled[2:]] == [int(value[0]) for value in plain[2:]]
    if law in ROUNDED:
        return
    exact = read(solve(model(law, method, EXACT_FORCE, EXACT_LENGTH), tmp_path, name="exact"), *NAMES)
    assert (exact[0] == EXACT_LENGTH * plain[0]).all() and (exact[1] == EXACT_FORCE * plain[1]).all()
    assert [int(value[0]) for value in exact[2:]] == [int(value[0]) for value in plain[2:]]


def test_no_law_is_forgotten():
    from pathlib import Path

    table = (Path(__file__).resolve().parents[2] / "src" / "input_keys.txt").read_text()
    assert set(re.findall(r"^law (\w+) \|", table, re.M)) == set(LAWS) | WITHOUT_UNITS


def test_other_units_of_curves_change_no_point(tmp_path):
    """A curve of rigid friction in SI units and in units of 2**-20 m, 2**-30 kg and 2**-20 s: steps, sets and statuses depend on
    error estimates, in which the frequency along the curve is an unknown beside the motion."""
    length, mass, time = 2.0**-20, 2.0**-30, 2.0**-20
    rows = []
    for name, (x, m, t) in {"si": (1.0, 1.0, 1.0), "small": (length, mass, time)}.items():
        force = m * x / t**2
        text = f"""
&structure type='matrices', n_dofs=2,
 mass={0.642443256604 / m!r}, 0.0, 0.0, {1.04693921848 / m!r}
 damping={0.0781822625261 / m * t!r}, {0.00233872487192 / m * t!r}, {0.00233872487192 / m * t!r}, {0.130552536457 / m * t!r}
 stiffness={2.15432404753 / m * t**2!r}, {-0.556457457382 / m * t**2!r},
  {-0.556457457382 / m * t**2!r}, {2.76242300318 / m * t**2!r} /
&tones frequency={1.31444158006 * t!r} /
&accuracy tolerance=1e-2 /
&load dof='x1', tuple=1, cos={0.432003490294 / force!r}, sin={-0.244179065838 / force!r} /
&law type='coulomb_rigid', dofs='x1', weights=1.0, limit={0.0844911178865 / force!r} /
&curve parameter='tones%frequency(1)', from={0.65722079003 * t!r}, to={2.103106528096 * t!r} /
"""
        result = solve(text, tmp_path, name=name)
        kinds, frequency, status, estimate = read(result, "curve_kind", "frequency", "status", "truncation_estimate")
        used = kinds > 0
        rows.append((frequency[used, 0] / t, status[used], estimate[used]))
    (frequency, status, estimate), (other_frequency, other_status, other_estimate) = rows
    assert len(frequency) == len(other_frequency)
    np.testing.assert_allclose(other_frequency, frequency, rtol=1e-9)
    np.testing.assert_array_equal(other_status, status)
    np.testing.assert_allclose(other_estimate, estimate, rtol=1e-3)
