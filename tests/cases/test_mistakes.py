"""Mistakes of beginners: none is silent. Each is answered by an error, or a warning, that names what is wrong or the right
value."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

from in_process import nhbm


def base(mass=1.0, damping=0.1, stiffness=1.0, tones=(0.9,)):
    return nhbm.Model(nhbm.Matrices(mass=mass, damping=damping, stiffness=stiffness), tones=tones)


def loaded(**keys):
    model = base(**keys)
    model.load("x1", 1, cos=0.3)
    return model


def stop(gap=0.1, stiffness_of_stop=20.0, **keys):
    model = loaded(**keys)
    model.law("elastic_stop", "x1", stiffness=stiffness_of_stop, gap=gap, label="stop")
    return model


def stop_with_samples():
    model = stop()
    model.set("sampling", samples=4)
    return model


def with_law(model, kind="cubic_spring", **keys):
    model.law(kind, "x1", **(keys or {"stiffness": 0.1}))
    return model


def with_load(model, dof="x1", tuple_=1, **keys):
    model.load(dof, tuple_, **keys)
    return model


def two_tones(first, second):
    model = base(tones=[first, second])
    with_load(with_load(model, "x1", (1, 0), cos=0.1), "x1", (0, 1), cos=0.1)
    return with_law(model)


def oscillator_of_10_hz(tones):
    model = nhbm.Model(nhbm.Matrices(mass=1.0, damping=2.0, stiffness=(20 * np.pi) ** 2), tones=tones)
    with_load(model, cos=1.0)
    return with_law(model, "elastic_stop", stiffness=1e4, gap=0.01, label="stop")


def falling_law():
    model = loaded()
    model.law(nhbm.law(lambda q: -0.1 * q**3), "x1")
    return model


def of_two(stiffness, mass=None):
    return nhbm.Model(
        nhbm.Matrices(mass=np.eye(2) if mass is None else mass, damping=0.1 * np.eye(2), stiffness=stiffness), tones=[0.9]
    )


MISTAKES = [
    ("unknown degree of freedom", lambda: with_load(base(), "x2", cos=1.0).solve(order=1),
     "unknown degree of freedom 'x2'; known: x1"),
    ("degree of freedom 0", lambda: with_load(base(), "0", cos=1.0).solve(order=1), "has 1 to 1"),
    ("number of a degree of freedom", lambda: with_load(base(), 5, cos=1.0).solve(order=1), "has 1 to 1"),
    ("tuple of two for one tone", lambda: with_load(base(), "x1", (1, 0), cos=1.0).solve(order=1), "tuple has 2 values, needs 1"),
    ("broken tuple", lambda: with_load(base(), "x1", 1.5, cos=1.0), "must be a whole number"),
    ("tuple as text", lambda: with_load(base(), "x1", "one", cos=1.0), "must be a whole number"),
    ("list in a tuple", lambda: with_load(base(), "x1", [[1]], cos=1.0), "must be a whole number"),
    ("load without amplitude", lambda: with_load(base()), "needs an amplitude: cos= or sin="),
    ("complex load", lambda: with_load(base(), cos=1 + 2j), "expected a real number"),
    ("load that is no number", lambda: with_load(base(), cos=float("nan")).solve(order=1), "must be finite"),
    ("the same load twice", lambda: with_load(with_law(loaded()), cos=0.3).solve(order=3), "loads 1 and 2 act at the same place"),
    ("no load", lambda: with_law(base()).solve(order=3), "no load acts"),
    ("negative gap", lambda: stop(gap=-0.1).solve(order=5), "for a stop on the other side: weights = -1"),
    ("gap in millimetres", lambda: stop(gap=150.0).solve(order=5), "lengths are in metres"),
    ("stop never touched", lambda: stop(gap=50.0).solve(order=5), "law 'stop' exerts no force"),
    ("stop never touched along a curve", lambda: stop(gap=50.0).curve("tones[0]", 0.5, 1.5, order=5), "law 'stop' exerts no force"),
    ("stop never touched in a sweep", lambda: stop(gap=50.0).sweep({"tones[0]": [0.8, 0.9]}, order=5),
     "law 'stop' exerts no force"),
    ("stop never touched by a response", lambda: stop(gap=50.0).response("x1 (1)", order=5), "law 'stop' exerts no force"),
    ("order and tolerance", lambda: stop().solve(order=5, tolerance=1e-3), "not both"),
    ("too few harmonics", lambda: stop(stiffness_of_stop=500.0).solve(order=2), "estimated error"),
    ("order 1 for a stiff stop", lambda: stop(gap=0.3, stiffness_of_stop=500.0).solve(order=1), "estimated error"),
    ("too few samples", lambda: stop_with_samples().solve(order=7), "needs at least 15"),
    ("tolerance above 1", lambda: stop().solve(tolerance=5.0), "must be 1.0 or less"),
    ("tolerance below rounding", lambda: stop().solve(tolerance=1e-14), "raise the tolerance"),
    ("mass that is not symmetric", lambda: of_two(np.eye(2), [[1.0, 0.5], [0.0, 1.0]]).solve(order=1), "between x2 and x1"),
    ("coupling in one direction", lambda: with_law(with_load(of_two([[2.0, -1.0], [0.0, 2.0]]), cos=1.0)).solve(order=3),
     "make the matrix symmetric"),
    ("matrices of two sizes", lambda: nhbm.Model(nhbm.Matrices(mass=np.eye(2), stiffness=np.eye(3)), tones=[1.0]),
     "square and equal"),
    ("list for a matrix", lambda: nhbm.Model(nhbm.Matrices(mass=[1.0, 2.0], stiffness=[1.0, 2.0]), tones=[1.0]), "np.diag"),
    ("negative mass", lambda: stop(mass=-1.0).solve(order=3), "the mass of x1 is negative"),
    ("no mass", lambda: stop(mass=0.0).solve(order=3), "all masses of the structure are zero"),
    ("negative damping", lambda: with_law(loaded(damping=-0.1)).solve(order=3), "make it positive"),
    ("no damping", lambda: stop(damping=0.0).solve(order=5), "give damping"),
    ("undamped resonance", lambda: loaded(damping=0.0, tones=[1.0]).solve(order=1), "undamped resonance"),
    ("negative stiffness", lambda: with_law(loaded(stiffness=-1.0), stiffness=1.0).solve(order=5), "make it positive"),
    ("force with the other sign", lambda: falling_law().solve(order=5), "change its sign"),
    ("misspelt law", lambda: with_law(loaded(), "elastik_stop", stiffness=1.0).solve(order=3), "did you mean 'elastic_stop'"),
    ("misspelt key", lambda: with_law(loaded(), "elastic_stop", stifness=1.0, gap=0.1).solve(order=3), "did you mean 'stiffness'"),
    ("missing key", lambda: with_law(loaded(), "elastic_stop", gap=0.1).solve(order=3), "missing key 'stiffness'"),
    ("two limits of friction",
     lambda: with_law(loaded(), "jenkins", stiffness=1.0, limit=0.1, friction_coefficient=0.2).solve(order=3),
     "either 'limit' or 'friction_coefficient'"),
    ("one label twice", lambda: with_law(stop(), "elastic_stop", stiffness=1.0, gap=0.2, label="stop"),
     "another group with the label"),
    ("misspelt path", lambda: stop().sweep({"stop.gapp": [0.1, 0.2]}, order=3), "did you mean 'gap'"),
    ("a key of tones as a path", lambda: stop().sweep({"hertz": [1.0, 2.0]}, order=3), "has no key"),
    ("texts for numbers", lambda: stop().sweep({"stop.gap": ["a", "b"]}, order=3), "must be a real number"),
    ("empty range", lambda: stop().curve("tones[0]", 1.0, 1.0, order=3), "the range is empty"),
    ("too few points", lambda: stop().curve("tones[0]", 0.5, 1.5, order=3, points=3), "call again with points="),
    ("peak of another tuple", lambda: stop().curve("tones[0]", 0.5, 1.5, order=3, peak_of="x1 (1,0)"), "such as 'x1 \\(1\\)'"),
    ("frequency 0", lambda: stop(tones=[0.0]).solve(order=3), "must be above 0.0"),
    ("negative frequency", lambda: stop(tones=[-1.0]).solve(order=3), "must be 0.0 or greater"),
    ("hertz for radians", lambda: oscillator_of_10_hz([10.0]).solve(order=3), "given in Hz\\? A natural frequency is 10.0 Hz"),
    ("radians for hertz", lambda: oscillator_of_10_hz({"hertz": 62.8}).solve(order=3), "given in rad/s\\?"),
    ("equal tones", lambda: two_tones(1.0, 1.0).solve(order=3), "use one tone of 1.0 rad/s"),
    ("nearly equal tones", lambda: two_tones(1.0, 1.0000001).solve(order=3), "their combination \\(1,-1\\)"),
    ("commensurate tones", lambda: two_tones(1.0, 2.0).solve(order=3), "use one tone of 1.0 rad/s"),
    ("harmonic beyond the order", lambda: stop().solve(order=3).nhbm.amplitude("x1", 9), "the highest is 3"),
    ("largest displacement as a number", lambda: stop().response("max x1", order=3), "dataset.nhbm.response"),
]  # fmt: skip


@pytest.mark.parametrize(("made", "words"), [pytest.param(made, words, id=name) for name, made, words in MISTAKES])
def test_no_mistake_is_silent(made, words):
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        try:
            made()
        except nhbm.ModelError as error:
            said = str(error)
        else:
            said = ""
    said = "\n".join([said, *(str(warning.message) for warning in issued)])
    assert re.search(words, said), said


def test_an_unknown_stability_is_not_false():
    model = loaded()
    model.law("cubic_spring", "x1", stiffness=0.1)
    model.set("stability", method="off")
    assert model.solve(order=3).nhbm.is_stable.item() is None


def test_a_response_is_a_number():
    model = loaded()
    model.law("cubic_spring", "x1", stiffness=0.1)
    assert float(model.solve(order=3).nhbm.response("x1")) > 0
