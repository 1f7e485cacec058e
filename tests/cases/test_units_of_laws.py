"""Every law in other units: lengths times 1e-9 and forces times 1e6 change no iteration of Newton's method and no digit
beyond rounding.

With powers of two near these nothing is rounded, and no bit may change. Time keeps its unit, so a key in N s/m is multiplied like
one in N/m. Examples and units are those of the tables of laws and keys.
"""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from program import read, solve

LENGTH, FORCE = 1e-9, 1e6
EXACT_LENGTH, EXACT_FORCE = 2.0**-30, 2.0**20
SAME = 1e-12

TABLES = runpy.run_path(str(Path(__file__).resolve().parents[2] / "tests" / "keys"))
LAWS = {law.name: law for law in TABLES["laws"]() if law.name != "user"}  # only its author knows the units of its parameters
UNITS = {(key.section, key.name): key.unit for key in TABLES["keys"]()}
POWERS = {"N": (1, 0), "m": (0, 1), "Pa": (1, -2)}  # of force and of length; of a second, a volt, a radian none
# A power of a length: the library of C rounds other lengths otherwise, powers of two apart as well.
ROUNDED = {"hertz", "rolling_bearing"}


def powers(unit, keys):
    """Powers of force and of length of a unit of the table of keys such as `N s/m3`; `N/m^n` has the exponent of the law."""
    force = length = 0.0
    above, _, below = unit.partition("/")
    for sign, factors in ((1, above), (-1, below)):
        for name, power in re.findall(r"([A-Za-z]+)\^?(\d+|n)?", factors):
            exponent = keys.get("exponent", [1.5])[0] if power == "n" else float(power or 1)
            force += sign * exponent * POWERS.get(name, (0, 0))[0]
            length += sign * exponent * POWERS.get(name, (0, 0))[1]
    return force, length


def units(law, key, keys):
    """Powers of each value of a key: the same for all, or of each its own, where `N/m, N/m2, ...` continues and by exponents."""
    unit = UNITS[f"law {law}", key]
    n = len(keys[key])
    if unit == "N per product of powers":
        of_terms = np.reshape(keys["displacement_exponents"], (n, -1)) + np.reshape(keys["velocity_exponents"], (n, -1))
        return [(1.0, -float(total)) for total in of_terms.sum(axis=1)]
    first, *others = unit.split(", ")
    if not others:
        return n * [powers(first, keys)]
    start, step = powers(first, keys), np.subtract(powers(others[0], keys), powers(first, keys))
    return [tuple(start + k * step) for k in range(n)]


def text_of(law, key, keys, force, length):
    """A key with its values in other units."""
    values = keys[key]
    if any(isinstance(value, (str, bool)) for value in values):
        return f"{key} = " + ", ".join(repr(value) if isinstance(value, str) else f".{str(value).lower()}." for value in values)
    if all(isinstance(value, int) for value in values) and not UNITS[f"law {law}", key]:
        return f"{key} = " + ", ".join(map(str, values))
    scales = [force**of_force * length**of_length for of_force, of_length in units(law, key, keys)]
    return f"{key} = " + ", ".join(repr(float(value * scale)) for value, scale in zip(values, scales))


def model(law, method, force=1.0, length=1.0):
    example = LAWS[law].keys
    keys = ", ".join(text_of(law, key, example, force, length) for key in example)
    scale = force / length
    mass = [repr(entry * scale) for entry in (1.0, 0.8, 1.0, 1.0)]
    stiffness = [[2.0, -0.7, 0.0, 0.0], [-0.7, 1.5, -0.2, 0.0], [0.0, -0.2, 3.0, -0.1], [0.0, 0.0, -0.1, 2.5]]
    entries = [repr(entry * scale) for row in stiffness for entry in row]
    return f"""
&structure type = 'matrices', n_dofs = 4, mass = {", ".join(mass)}, stiffness = {", ".join(entries)}, damping_mass = 1.0 /
&tones frequency = 0.7, 1.1313708498984762 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, 0, cos = {0.6 * force!r} /
&load dof = 'x2', tuple = 0, 1, cos = {0.4 * force!r}, sin = {0.2 * force!r} /
&law type = '{law}', {LAWS[law].place}, {keys} /
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
    if method == "newton":  # rounding grows in the updates of Broyden's method, over sixty iterations of some laws
        assert [int(value[0]) for value in scaled[2:]] == [int(value[0]) for value in plain[2:]]
    if law in ROUNDED:
        return
    exact = read(solve(model(law, method, EXACT_FORCE, EXACT_LENGTH), tmp_path, name="exact"), *NAMES)
    assert (exact[0] == EXACT_LENGTH * plain[0]).all() and (exact[1] == EXACT_FORCE * plain[1]).all()
    assert [int(value[0]) for value in exact[2:]] == [int(value[0]) for value in plain[2:]]


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
