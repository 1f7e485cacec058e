"""Three tones: their order does not matter, and a tone without effect changes nothing."""

import itertools

import numpy as np
import pytest

from program import coefficients_by_tuple, solve

# Of the largest coefficient: two orders of the tones differ only by rounding, about 1e-15 in the residual.
TOLERANCE = 1e-12

OMEGA = (0.6, 0.6 * np.sqrt(2.0), 0.6 * np.sqrt(5.0))
LOAD = (0.30, 0.25, 0.20)

ONE_MASS = """&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0,
   ground_stiffness = 4.0, damping_mass = 0.3 /
"""
BEAM = """&structure type = 'beam', length = 1.0, bending_stiffness = 0.1, mass_per_length = 1.0, n_elements = 4,
   damping_diagonal = 0.1 /
"""
STOP = "&law type = 'elastic_stop', dof = '{dof}', gap = {gap}, stiffness = 4.0 /\n"
WALL = "&law type = 'rigid_wall', dof = '{dof}', gap = {gap}, augmentation = 3.0 /\n"

MODELS = {
    "elastic stop": (ONE_MASS, "x1", STOP, 0.1, "order = 3"),
    "rigid wall": (ONE_MASS, "x1", WALL, 0.1, "order = 2"),
    "beam at a stop, diamond": (BEAM, "v3", STOP, 0.04, "set = 'diamond', order = 3"),
}


def model(name, tones):
    """Input of a model whose tones are `tones`, numbers into OMEGA and LOAD; the load of a tone may be replaced."""
    structure, dof, law, gap, harmonics = MODELS[name]
    lines = [structure, f"&tones frequency = {', '.join(repr(float(omega)) for omega, _ in tones)} /"]
    lines += [f"&harmonics {harmonics} /", "&sampling samples = 16 /", "&solver tolerance = 1e-14 /"]
    lines.append("&error_estimate truncation = 10.0, aliasing = 10.0, penetration = 10.0, impact = 10.0 /")
    for m, (_, force) in enumerate(tones):
        entries = ", ".join(str(int(m == k)) for k in range(len(tones)))
        lines.append(f"&load dof = '{dof}', tuple = {entries}, cos = {force!r} /")
    lines.append(law.format(dof=dof, gap=gap) + f"&output dofs = '{dof}' /")
    return "\n".join(lines) + "\n"


def solution(name, tones, folder):
    result = solve(model(name, tones), folder)
    return coefficients_by_tuple(result)


def look_up(harmonics, j):
    """(cos, sin) of tuple j, either sign of which is stored."""
    if j in harmonics:
        return np.array(harmonics[j])
    cosine, sine = harmonics[tuple(-k for k in j)]
    return np.array([cosine, -sine])


@pytest.fixture(scope="module", params=MODELS)
def in_order(request, tmp_path_factory):
    tones = list(zip(OMEGA, LOAD))
    return request.param, solution(request.param, tones, tmp_path_factory.mktemp("order"))


def test_contact_couples_the_tones(in_order):
    """A model without contact would make the next tests trivial: combination tones must exist."""
    _, harmonics = in_order
    largest = np.abs(list(harmonics.values())).max()
    assert np.abs(look_up(harmonics, (1, 1, 0))).max() > 1e-2 * largest
    assert np.abs(look_up(harmonics, (0, 1, -1))).max() > 1e-2 * largest


@pytest.mark.parametrize("order", list(itertools.permutations(range(3)))[1:], ids=str)
def test_order_of_tones_does_not_matter(in_order, order, tmp_path):
    name, harmonics = in_order
    tones = [(OMEGA[m], LOAD[m]) for m in order]
    permuted = solution(name, tones, tmp_path)
    assert len(permuted) == len(harmonics)
    largest = np.abs(list(harmonics.values())).max()
    for j, values in harmonics.items():
        there = look_up(permuted, tuple(j[m] for m in order))
        assert np.abs(there - values).max() <= TOLERANCE * largest, j


PLACES = [(name, place) for name in MODELS for place in range(3)]
LONG = [("rigid wall", 0), ("rigid wall", 2)]  # seconds each


@pytest.mark.parametrize(("name", "place"), [pytest.param(*case, marks=[pytest.mark.long] * (case in LONG)) for case in PLACES])
def test_tone_without_load_changes_nothing(name, place, tmp_path):
    """The balance of three tones, one without loads, has the solution of two, for any position of that tone."""
    two = solution(name, list(zip(OMEGA[:2], LOAD[:2])), tmp_path)
    tones = list(zip(OMEGA[:2], LOAD[:2]))
    tones.insert(place, (OMEGA[2], 0.0))
    three = solution(name, tones, tmp_path)
    largest = np.abs(list(two.values())).max()
    for j, values in three.items():
        rest = j[:place] + j[place + 1 :]
        expected = look_up(two, rest) if j[place] == 0 else np.zeros(2)
        assert np.abs(np.array(values) - expected).max() <= TOLERANCE * largest, j
    assert sum(j[place] == 0 for j in three) == len(two)


def test_third_tone_of_order_zero_is_no_tone(tmp_path):
    name = "elastic stop"
    two = solution(name, list(zip(OMEGA[:2], LOAD[:2])), tmp_path)
    tones = [*zip(OMEGA[:2], LOAD[:2]), (OMEGA[2], 0.0)]
    text = model(name, tones).replace("order = 3", "order = 3, 3, 0").replace("samples = 16", "samples = 16, 16, 1")
    text = text.replace("&load dof = 'x1', tuple = 0, 0, 1, cos = 0.0 /\n", "")
    three = coefficients_by_tuple(solve(text, tmp_path, name="flat"))
    largest = np.abs(list(two.values())).max()
    assert len(three) == len(two)
    for j, values in three.items():
        assert j[2] == 0
        assert np.abs(np.array(values) - look_up(two, j[:2])).max() <= TOLERANCE * largest, j
