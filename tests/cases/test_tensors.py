"""Polynomials of several coordinates with terms in a file: the same as from lists, errors are named, changes are detected."""

import itertools
import os

import numpy as np
import pytest

from in_process import nhbm
from program import read, run, solve

TERMS = [(0.5, "a", "a a a"), (2.0, "a", "a b b"), (2.0, "b", "a a b"), (8.0, "b", "b b b"), (0.3, "a", "a b"), (0.15, "b", "a a")]
LAW = "&law type = 'polynomial_coupled', label = 'shape', dofs = 'a', 'b', file = 'terms.txt' /\n"
INPUT = (
    "&structure type = 'matrices', n_dofs = 2, labels = 'a', 'b', mass = 1.0, 1.0, damping = 0.05, 0.1, stiffness = 1.0, 4.0 /\n"
    "&tones frequency = 1.3 /\n&harmonics order = 9 /\n&load dof = 'a', tuple = 1, cos = 0.3 /\n" + LAW
)


def table(terms):
    return "! value, acts on, multiplied\n\n" + "".join(f"{c!r}\t{on}  {of} # a term\r\n" for c, on, of in terms)


def oscillators(**law):
    matrices = nhbm.Matrices(mass=np.eye(2), damping=np.diag([0.05, 0.1]), stiffness=np.diag([1.0, 4.0]), labels=["a", "b"])
    model = nhbm.Model(matrices, tones=[1.3])
    model.load("a", 1, cos=0.3)
    model.law("polynomial_coupled", ["a", "b"], label="shape", **law)
    return model


def test_a_file_is_as_good_as_lists(tmp_path):
    (tmp_path / "terms.txt").write_text(table(TERMS))
    exponents = [of.split().count(name) for _, _, of in TERMS for name in ("a", "b")]
    lists = oscillators(coefficients=[c for c, _, _ in TERMS], acts_on=[on for _, on, _ in TERMS], displacement_exponents=exponents)
    other = oscillators(file=str(tmp_path / "terms.txt"))
    expected = lists.solve(order=9).coefficients.values
    np.testing.assert_array_equal(other.solve(order=9).coefficients.values, expected)
    other.set("harmonics", order=9)
    (coefficients,) = read(solve(other.to_namelist(), tmp_path), "coefficients")
    np.testing.assert_array_equal(coefficients, expected)


@pytest.mark.parametrize("line, message", [
    ("abc a a", "line 3: 'abc' is not a number"), ("inf a a", "line 3: 'inf' is not a number"),
    ("1.0 a c", "line 3: 'c' is not one of 'dofs'"),
    ("1.0 a", "line 3: a term needs a number"), ("1.0 a" + 31 * " b", "line 3: a degree of freedom occurs more than 30 times"),
    ("", "has no terms"),
])  # fmt: skip
def test_what_is_wrong_has_its_line(line, message, tmp_path):
    (tmp_path / "terms.txt").write_text(f"! a table\n\n{line}\n")
    (tmp_path / "case.nml").write_text(INPUT)
    assert f"&law: file: 'terms.txt'{',' if 'line' in message else ''} {message}" in run("solve", "case.nml", cwd=tmp_path).stderr


def test_files_and_lists_and_what_is_no_file(tmp_path):
    (tmp_path / "case.nml").write_text(INPUT)
    assert "'terms.txt' does not exist" in run("solve", "case.nml", cwd=tmp_path).stderr
    os.mkfifo(tmp_path / "terms.txt")
    assert "is a pipe or a device" in run("solve", "case.nml", cwd=tmp_path).stderr
    os.remove(tmp_path / "terms.txt")
    (tmp_path / "terms.txt").write_text(table(TERMS))
    done = run("solve", "case.nml", "--set", "law(shape)%acts_on='a'", cwd=tmp_path)
    assert "acts_on: give either 'file' or lists of terms, not both" in done.stderr


def test_another_file_is_noticed(tmp_path):
    (tmp_path / "terms.txt").write_text(table(TERMS))
    solve(INPUT, tmp_path)
    (tmp_path / "terms.txt").write_text(table(TERMS[:-1]))
    assert "shape: terms.txt, CRC-32" in run("resume", "case.h5", cwd=tmp_path).stderr


def test_twenty_modes(tmp_path):
    """All quadratic and cubic tensors from a potential, 35,000 terms: recognised as a gradient, as required for energies of
    modes."""
    names, random = [f"q{i}" for i in range(1, 21)], np.random.default_rng(1)
    terms = []
    for factors in [*itertools.combinations_with_replacement(names, 3), *itertools.combinations_with_replacement(names, 4)]:
        c = 1e-3 * random.normal()
        for on in sorted(set(factors)):
            rest = list(factors)
            rest.remove(on)
            terms.append((c * factors.count(on), on, " ".join(rest)))
    assert len(terms) == 35000
    (tmp_path / "terms.txt").write_text(table(terms))
    listed = ", ".join(f"'{name}'" for name in names)
    text = (
        f"&structure type = 'matrices', n_dofs = 20, labels = {listed}, mass = {', '.join(20 * ['1.0'])}"
        f" stiffness = {', '.join(str(float(i**1.9)) for i in range(1, 21))} /\n&tones frequency = 1.0, unknown = .true. /\n"
        "&harmonics order = 5 /\n" + LAW.replace("'a', 'b'", listed) + "&normal_mode energy = 0.1 /\n"
        "&error_estimate is_on = .false. /\n&stability method = 'off' /\n"
    )
    (residual,) = read(solve(text, tmp_path), "residual")
    assert residual < 1e-10
