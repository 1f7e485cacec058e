"""Reduced models: exact where nothing is left out, converging, and with an error that is the true one."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from nhbm import ModelError, Structure, examples, factors, reduction, rotors
from nhbm.command import main
from nhbm.factors import Factors, lowest_modes
from nhbm.reduction import MODAL, band, compare, load_matrix, reduce


def flexibility(model, names, w):
    dofs = [model.labels.index(name) for name in names]
    dynamic = model.stiffness * (1 + 1e-3j) - w**2 * model.mass
    return np.linalg.inv(dynamic.toarray())[np.ix_(dofs, dofs)]


@pytest.mark.parametrize("method", MODAL)
def test_all_modes_leave_nothing_out(chain, method):
    chain = dataclasses.replace(chain, damping=None, loads={})
    reduced = reduce(chain, ["contact.z", "n9.z"], 9, method)
    for w in (0.0, 0.7, 3.0):
        exact = flexibility(chain, ["n5.z", "n2.z", "n9.z"], w)
        assert reduced.labels[:3] == ["n5.z", "n2.z", "n9.z"]
        np.testing.assert_allclose(flexibility(reduced, reduced.labels[:3], w), exact, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("left_out", [*(pytest.param(n, marks=pytest.mark.long) for n in (0, 5)), 20])
def test_nearly_all_modes_of_a_free_interface_keep_their_digits(block, left_out):
    """What they leave of the flexibility is rounding in some directions, and small in others. At rest and at a resonance."""
    names = [block.labels[dof] for dof in block.dofs_of("right.z")]
    reduced = reduce(dataclasses.replace(block, loads={}), ["right.z"], block.n_dofs - len(names) - left_out)
    assert reduced.n_dofs <= block.n_dofs
    lowest = np.sqrt(scipy.linalg.eigh(block.stiffness.toarray(), block.mass.toarray(), eigvals_only=True)[0])
    for w, least in ((0.0, 1e-10), (lowest, 1e-6)):
        exact = flexibility(block, names, w)
        assert abs(flexibility(reduced, names, w) - exact).max() < least * abs(exact).max()


def test_mass_that_is_not_symmetric_is_refused(chain):
    mass = chain.mass.tolil()
    mass[2, 3] = 0.1
    with pytest.raises(ModelError, match="the mass is not symmetric"):
        reduce(dataclasses.replace(chain, mass=mass), ["contact.z"], 3)


def test_dependent_retained_dofs_are_reported(chain):
    link = np.zeros((12, 12))
    link[np.ix_([3, 4], [3, 4])] = [[1e20, -1e20], [-1e20, 1e20]]
    rigid = dataclasses.replace(chain, stiffness=chain.stiffness + sp.csr_matrix(link))
    with pytest.raises(ModelError, match="do not move independently|is not positive definite"):
        reduce(rigid, ["n4.z", "n5.z"], 3)


@pytest.mark.parametrize("method", MODAL)
def test_static_answer_is_exact(block, method):
    retained = ["right.z"]
    reduced = reduce(block, retained, 3, method)
    names = [block.labels[dof] for dof in block.dofs_of("right.z")]
    exact = flexibility(block, names, 0.0)
    np.testing.assert_allclose(flexibility(reduced, names, 0.0), exact, rtol=1e-7, atol=1e-8 * abs(exact).max())


@pytest.mark.parametrize("method", MODAL)
def test_error_that_is_reported_is_the_true_one(block, method):
    reduced = reduce(block, ["right.z"], 8, method)
    names = [block.labels[dof] for dof in block.dofs_of("right.z")]
    report = compare(block, reduced, [5.0e3, 3.0e4])
    for w, reported in zip(report.frequencies, report.errors):
        exact = flexibility(block, names, w)
        true = abs(flexibility(reduced, names, w) - exact).max() / abs(exact).max()
        assert reported == pytest.approx(true, rel=0.9, abs=1e-9)
    assert report.errors[0] < 1e-4


@pytest.mark.parametrize("method", [MODAL[0], *(pytest.param(m, marks=pytest.mark.long) for m in MODAL[1:])])
def test_largest_error_that_is_reported_is_that_of_the_band(block, method):
    """Within a factor of ten of the largest of many frequencies and all resonances of both models."""
    reduced = reduce(block, ["right.z"], 6, method)
    up_to = 6.0e4
    report = compare(block, reduced, band(reduced, up_to))
    full, small = (np.sqrt(scipy.linalg.eigh(m.stiffness.toarray(), m.mass.toarray(), eigvals_only=True)) for m in (block, reduced))
    names = [block.labels[dof] for dof in block.dofs_of("right.z")]
    errors = []
    for w in np.concatenate([np.linspace(0.0, up_to, 40), full[full < up_to], small[small < up_to]]):
        exact = flexibility(block, names, w)
        errors.append(abs(flexibility(reduced, names, w) - exact).max() / abs(exact).max())
    assert max(errors) / 10 < report.errors.max() < 10 * max(errors)
    assert report.resonances == (small < up_to).sum() > 2
    off = np.abs(small[: report.resonances] / full[: report.resonances] - 1).max()
    assert report.resonance_error == pytest.approx(off, rel=0.01, abs=1e-9)


def test_a_requested_error_is_met(tmp_path, capsys):
    pytest.importorskip("skfem")
    plate = examples.plate(n_x=8, n_y=6)
    plate.sets["corner"] = np.array([examples.nearest_node(plate, (0.1, 0.1, 0.0)), examples.nearest_node(plate, (0.3, 0.2, 0.0))])
    path, out = str(tmp_path / "full.h5"), str(tmp_path / "small.h5")
    plate.write(path)
    words = ["reduce", path, "--keep", "corner.z", "--modes", "10", "-o", out]
    assert main([*words, "--tolerance", "1e-8", "--up-to", "4e3"]) == 0
    small = Structure.read(out)
    assert small.n_dofs < plate.n_dofs
    names = [plate.labels[dof] for dof in plate.dofs_of("corner.z")]
    for w in np.linspace(0.0, 4.0e3, 9):
        exact = flexibility(plate, names, w)
        assert abs(flexibility(small, names, w) - exact).max() < 1e-7 * abs(exact).max()
    capsys.readouterr()
    words.append("--overwrite")
    for more, message in (
        (["--tolerance", "1e-8"], "--tolerance needs --up-to"),
        (["--modes", "-3"], "--modes must be 0 or more, not -3"),
        (["--up-to", "nan"], "--up-to must be above 0, not nan"),
    ):
        assert main([*words, *more]) == 2 and message in capsys.readouterr().err
    assert main(["reduce", out, "--keep", "corner.z", "-o", path, "--overwrite"]) == 2
    assert "the model is reduced already" in capsys.readouterr().err
    assert main([*words, "--tolerance", "1e-18", "--up-to", "4e3", "--method", MODAL[0]]) == 2  # MODAL[1] may err by exactly zero
    assert "--tolerance 1e-18 is not met" in capsys.readouterr().err


def test_more_modes_are_better(block):
    errors = [compare(block, reduce(block, ["right.z"], n, "craig-bampton"), 2.0e4).errors[0] for n in (4, 10, 30)]
    assert errors[0] > 5 * errors[1] > 25 * errors[2]


def test_what_moves_as_a_whole():
    pytest.importorskip("skfem")
    free = examples.solid(n_x=4, n_y=1, n_z=1, clamped="none")
    reduced = reduce(free, ["right.z"], 12)
    assert compare(free, reduced, 1.0e4).errors[0] < 1e-5
    with pytest.raises(ModelError, match="leave --method craig-bampton out"):
        reduce(free, ["right.z"], 12, "craig-bampton")


def test_loads_and_recovery(chain):
    reduced = reduce(chain, ["contact.z"], 3)
    full = np.zeros(12)
    full[chain.loads["push"][0]] = chain.loads["push"][1]
    load = np.zeros(reduced.n_dofs)
    load[reduced.loads["push"][0]] = reduced.loads["push"][1]
    static = reduced.recovery.matrix @ np.linalg.solve(reduced.stiffness.toarray(), load)
    np.testing.assert_allclose(static, np.linalg.solve(chain.stiffness.toarray(), full), rtol=1e-10)


@pytest.mark.parametrize("method", MODAL)
def test_loads_on_retained_dofs_add_nothing(block, method):
    """Their static shapes are there already; rounding must not become shapes that move retained degrees of freedom."""
    retained = block.dofs_of("right.z")
    loads = {"push": (np.array(retained), np.ones(len(retained))), "pull": (np.array(retained[:2]), np.array([1.0, -1.0]))}
    reduced = reduce(dataclasses.replace(block, loads=loads), ["right.z"], 6, method)
    assert reduced.n_dofs == len(retained) + 6
    unit = np.eye(len(retained), reduced.n_dofs)
    np.testing.assert_allclose(reduced.recovery.matrix[retained], unit, atol=1e-12)


@pytest.mark.parametrize("method", [*MODAL, "krylov"])
def test_blocks_change_nothing(block, method, monkeypatch):
    n = 6 if method in MODAL else 0
    whole = reduce(block, ["right.z"], n, method, 2.0e4)
    monkeypatch.setattr(reduction, "BLOCK", 5)
    monkeypatch.setattr(factors, "BLOCK", 3)
    parts = reduce(block, ["right.z"], n, method, 2.0e4)
    names = [block.labels[dof] for dof in block.dofs_of("right.z")]
    for w in (0.0, 1.3e4):
        a, b = (flexibility(reduced, names, w) for reduced in (whole, parts))
        np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-10 * abs(a).max())
        unit = np.eye(whole.n_dofs)[:, :1]  # of the first degree of freedom, which all of them recover
        a, b = (
            reduced.recovery.matrix @ np.linalg.solve((reduced.stiffness - w**2 * reduced.mass).toarray(), unit)
            for reduced in (whole, parts)
        )
        np.testing.assert_allclose(b, a, rtol=1e-7, atol=1e-9 * abs(a).max())


@pytest.mark.long
def test_memory_is_that_of_the_shapes():
    """And of small matrices: nothing of their size has a second copy. It was six of them."""
    pytest.importorskip("skfem")
    model = examples.solid(n_x=30, n_y=6, n_z=1)
    tracemalloc.start()
    try:
        reduced = reduce(model, ["top.z"], 10)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2.5 * reduced.recovery.matrix.nbytes


def test_what_does_not_fit_into_memory_is_refused(block, monkeypatch):
    monkeypatch.setattr(reduction, "_available_memory", lambda: 1.0e5)
    with pytest.raises(ModelError, match=r"shapes of 216 degrees of freedom need .* GiB of memory.*keep fewer"):
        reduce(block, ["right.z"], 6)


def test_more_than_a_reduced_model_may_have(block, monkeypatch):
    monkeypatch.setitem(reduction.LARGEST_REDUCED, "craig-bampton", 30)
    with pytest.raises(ModelError, match="more than a reduced model may have by the method 'craig-bampton', 30"):
        reduce(block, ["right.z"], 30, "craig-bampton")


def test_file_of_a_reduced_model(chain, tmp_path):
    path = tmp_path / "full.h5"
    chain.write(path)
    out = tmp_path / "small.h5"
    assert main(["reduce", str(path), "--keep", "contact.z", "--modes", "3", "-o", str(out)]) == 0
    small = Structure.read(out)
    assert small.labels == ["n5.z", "n2.z", "q1", "q2", "q3", "q4"]
    assert small.recovery.matrix.shape == (12, 6)
    assert small.dofs_of("contact.z") == [0, 1]


@pytest.mark.parametrize("method", MODAL)
def test_degrees_of_freedom_without_mass(chain, method):
    """Kept or not, they are followed by the stiffness; nothing is left out with all modes that there are."""
    mass = chain.mass.diagonal()
    mass[[4, 7]] = 0.0
    light = dataclasses.replace(chain, mass=sp.diags(mass), damping=None, loads={})
    reduced = reduce(light, ["contact.z", "n9.z"], 9, method)
    for w in (0.0, 0.7, 3.0):
        exact = flexibility(light, ["n5.z", "n2.z", "n9.z"], w)
        np.testing.assert_allclose(flexibility(reduced, reduced.labels[:3], w), exact, rtol=1e-9, atol=1e-12)
    assert compare(light, reduced, [0.7]).errors[0] < 1e-9


def test_modes_where_half_of_the_masses_are_none():
    """ARPACK returns motions without mass as modes; frequencies are those with these condensed."""
    n = 200
    k = sp.diags([np.full(n, 2.1), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], [0, 1, -1]).tocsr()
    heavy, light = np.arange(0, n, 2), np.arange(1, n, 2)
    mass = sp.diags(np.where(np.arange(n) % 2 == 0, np.linspace(1.0, 2.0, n), 0.0)).tocsr()
    inside = k[light][:, light].toarray()
    condensed = k[heavy][:, heavy].toarray() - k[heavy][:, light] @ np.linalg.solve(inside, k[light][:, heavy].toarray())
    exact = scipy.linalg.eigh(condensed, mass[heavy][:, heavy].toarray(), eigvals_only=True)
    for n_modes in (20, 90, 150):
        values, shapes = lowest_modes(k, mass, n_modes)
        assert len(values) == min(n_modes, 100)
        np.testing.assert_allclose(values, exact[:n_modes], rtol=1e-9)
        np.testing.assert_allclose(shapes.T @ mass @ shapes, np.eye(len(values)), atol=1e-8)


def test_modes_by_arpack_and_lapack(block):
    import scipy.linalg

    exact = scipy.linalg.eigh(block.stiffness.toarray(), block.mass.toarray(), eigvals_only=True)[:8]
    np.testing.assert_allclose(lowest_modes(block.stiffness, block.mass, 8)[0], exact, rtol=1e-9)


def test_superlu_where_there_is_no_cholmod(block, monkeypatch):
    import sys

    b = np.cos(np.arange(block.n_dofs))
    expected = Factors(block.stiffness, "stiffness").solve(b)
    monkeypatch.setitem(sys.modules, "cvxopt", None)
    np.testing.assert_allclose(Factors(block.stiffness, "stiffness").solve(b), expected, rtol=1e-8)
    with pytest.raises(ModelError, match="stiffness is not positive definite"):
        Factors(-1.0 * block.stiffness, "stiffness")


@pytest.mark.parametrize("method", MODAL)
def test_error_of_a_body_that_turns_is_reported_at_its_whirls(block, method):
    """A bar with Coriolis terms about its axis: within a factor of ten of the largest of many frequencies and all whirls."""
    at = {(node, d): i for i, (node, d) in enumerate(zip(block.dof_node, block.dof_direction))}
    across = np.zeros((block.n_dofs, block.n_dofs))
    for (node, direction), i in at.items():
        if direction == "y":
            across[i, at[node, "z"]], across[at[node, "z"], i] = -1.0, 1.0
    turning = dataclasses.replace(block, gyroscopic=sp.csr_matrix(600.0 * block.mass @ across), loads={})
    reduced = reduce(turning, ["right.z"], 14, method)
    dofs = turning.dofs_of("right.z")

    def exact(model, retained, w):
        dynamic = model.stiffness * (1 + 1e-3j) - w**2 * model.mass + 1j * w * model.gyroscopic
        return np.linalg.solve(dynamic.toarray(), np.eye(model.n_dofs)[:, retained])[retained]

    n, up_to = reduced.n_dofs, 1.5e4
    states = np.block([[np.zeros((n, n)), np.eye(n)], [-reduced.stiffness.toarray(), -reduced.gyroscopic.toarray()]])
    whirls = scipy.linalg.eigvals(states, scipy.linalg.block_diag(np.eye(n), reduced.mass.toarray())).imag
    errors = []
    for w in np.concatenate([np.linspace(0.0, up_to, 20), whirls[(whirls > 1.0) & (whirls < up_to)]]):
        full = exact(turning, dofs, w)
        errors.append(abs(exact(reduced, list(range(len(dofs))), w) - full).max() / abs(full).max())
    assert max(errors) / 10 < compare(turning, reduced, band(reduced, up_to)).errors.max() < 10 * max(errors)


def cross_coupled(cross, everywhere=False):
    """A shaft in bearings whose forces across the motion make the stiffness unsymmetric; follower forces all along it."""
    shaft = rotors.rotor(0.6, 0.02, 24, [(0.3, 2.0, 2e-3, 4e-3)], [(0.0, 2e6, 300.0), (0.6, 2e6, 300.0)], 900.0)
    of = {label: i for i, label in enumerate(shaft.labels)}
    across = sp.lil_matrix((shaft.n_dofs, shaft.n_dofs))
    for n in shaft.node_numbers if everywhere else (1, len(shaft.node_numbers)):
        across[of[f"n{n}.x"], of[f"n{n}.y"]], across[of[f"n{n}.y"], of[f"n{n}.x"]] = cross, -cross
    stiffness = shaft.stiffness + sp.csr_matrix(across)
    return dataclasses.replace(shaft, stiffness=stiffness, loads={"push": ([of["n20.x"]], [1.0])})


def exact_flexibility(model, names, w):
    dofs = [model.labels.index(name) for name in names]
    dynamic = model.stiffness * (1 + 1e-3j) - w**2 * model.mass + 1j * w * (model.gyroscopic + model.damping)
    return np.linalg.inv(dynamic.toarray())[np.ix_(dofs, dofs)]


@pytest.mark.parametrize("method", MODAL)
@pytest.mark.parametrize("everywhere", [False, True])
def test_unsymmetric_stiffness(method, everywhere):
    """The static answer of bearings is exact, no half of the stiffness is lost, and the reported error is that of the band."""
    shaft = cross_coupled(2e5 if everywhere else 1e6, everywhere)
    reduced = reduce(shaft, ["disk1"], 12, method)
    names = reduced.labels[:4]
    half = dataclasses.replace(shaft, stiffness=(shaft.stiffness + shaft.stiffness.T) / 2)
    exact = exact_flexibility(shaft, names, 0.0)
    assert abs(exact_flexibility(half, names, 0.0) - exact).max() > 0.03 * abs(exact).max()
    if not everywhere:
        assert abs(exact_flexibility(reduced, names, 0.0) - exact).max() < 1e-9 * abs(exact).max()
    up_to, states = 4000.0, 2 * reduced.n_dofs
    report = compare(shaft, reduced, band(reduced, up_to))
    n = reduced.n_dofs
    a = np.zeros((states, states))
    a[:n, n:], a[n:, :n], a[n:, n:] = np.eye(n), -reduced.stiffness.toarray(), -reduced.gyroscopic.toarray()
    whirls = scipy.linalg.eigvals(a, scipy.linalg.block_diag(np.eye(n), reduced.mass.toarray())).imag
    errors = []
    for w in np.concatenate([np.linspace(0.0, up_to, 30), whirls[(whirls > 1.0) & (whirls < up_to)]]):
        exact = exact_flexibility(shaft, names, w)
        errors.append(abs(exact_flexibility(reduced, names, w) - exact).max() / abs(exact).max())
    assert max(errors) / 10 < report.errors.max() < 10 * max(errors)
    assert max(errors) < (1e-2 if everywhere else 1e-3)


def response(model, dofs, forces, w):
    """Motion of some degrees of freedom under some forces (n_dofs, any) at a frequency."""
    matrices = model.matrices()
    none = sp.csr_matrix(model.mass.shape)
    viscous = matrices.get("damping", none) + matrices.get("gyroscopic", none)
    dynamic = model.stiffness + 1j * matrices.get("structural", none) - w**2 * model.mass + 1j * w * viscous
    return spla.spsolve(sp.csc_matrix(dynamic), forces.astype(complex)).reshape(len(forces), -1)[dofs]


def largest_difference(full, small, names, up_to):
    """Of the motion of the retained degrees of freedom under forces at these and the loads, at frequencies nothing was tuned to."""
    worst = 0.0
    for w in up_to * np.array([0.0123, 0.257, 0.533, 0.871, 0.997]):
        answers = []
        for model in (full, small):
            dofs = [model.labels.index(name) for name in names]
            unit = np.zeros((model.n_dofs, len(dofs)))
            unit[dofs, np.arange(len(dofs))] = 1.0
            answers.append(response(model, dofs, np.hstack([unit, load_matrix(model)]), w))
        worst = max(worst, np.abs(answers[1] - answers[0]).max() / np.abs(answers[0]).max())
    return worst


KEPT = ["n1.z", "n150.z", "n299.z"]


@pytest.fixture
def long_chain():
    """300 masses in a row, held at one end, damped in proportion, with a load on all of them; ten resonances up to .11 rad/s."""
    n = 300
    stiffness = sp.diags([np.r_[np.full(n - 1, 2.0), 1.0], -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1]).tocsr()
    mass = sp.diags(1.0 + 0.1 * (np.arange(n) % 5)).tocsr()
    return Structure(mass=mass, stiffness=stiffness, damping=1e-2 * stiffness + 1e-4 * mass,
                     labels=[f"n{i + 1}.z" for i in range(n)],
                 node_numbers=np.arange(1, n + 1), coordinates=np.zeros((n, 3)), dof_node=np.arange(n), dof_direction=["z"] * n,
                 loads={"all": (np.arange(n), np.ones(n))})  # fmt: skip


def krylov(model, up_to=0.11, **more):
    return reduce(model, KEPT, method="krylov", up_to=up_to, **more)


def test_a_krylov_space_answers_as_the_whole(long_chain):
    small = krylov(long_chain)
    assert small.labels[:3] == KEPT and small.n_dofs < 60 and small.up_to == 0.11
    assert largest_difference(long_chain, small, KEPT, 0.11) < 1e-9
    shapes = small.stiffness.toarray()[3:, 3:]
    assert np.count_nonzero(shapes - np.diag(np.diag(shapes))) == 0  # which makes it cheap to solve with


def test_a_krylov_space_grows_with_the_tolerance_and_the_frequency(long_chain):
    few, many = krylov(long_chain, tolerance=1e-3), krylov(long_chain)
    assert few.n_dofs < many.n_dofs < krylov(long_chain, up_to=0.3).n_dofs
    assert 1e-9 < largest_difference(long_chain, few, KEPT, 0.11) < 1e-2


def test_dashpots_and_skew_stiffness_stay_exact(long_chain):
    damping, stiffness = long_chain.damping.tolil(), long_chain.stiffness.tolil()
    damping[76, 76] += 0.3
    stiffness[200, 201], stiffness[201, 200] = stiffness[200, 201] + 2e-3, stiffness[201, 200] - 2e-3
    full = dataclasses.replace(long_chain, damping=damping.tocsr(), stiffness=stiffness.tocsr())
    small = krylov(full)
    assert small.labels[:6] == [*KEPT, "n77.z", "n201.z", "n202.z"]
    assert largest_difference(full, small, KEPT, 0.11) < 1e-9


def test_damping_all_over_is_projected(long_chain):
    full = dataclasses.replace(long_chain, damping=sp.diags(2e-2 * np.linspace(0.0, 1.0, 300) ** 2).tocsr())
    small = krylov(full, up_to=0.05, tolerance=1e-8)
    assert small.n_dofs < 100 and largest_difference(full, small, KEPT, 0.05) < 1e-8


def test_free_bodies_and_structural_damping(long_chain):
    stiffness = long_chain.stiffness.tolil()
    stiffness[0, 0] = 1.0
    free = dataclasses.replace(long_chain, stiffness=stiffness.tocsr(), damping=None, structural=0.01 * stiffness.tocsr())
    assert largest_difference(free, krylov(free), KEPT, 0.11) < 1e-9


def test_impossible_krylov_spaces_are_reported(long_chain):
    soft = long_chain.stiffness.tolil()
    soft[9, 9] = -50.0
    with pytest.raises(ModelError, match="is not positive definite"):
        krylov(dataclasses.replace(long_chain, stiffness=soft.tocsr()))
    with pytest.raises(ModelError, match="needs the highest frequency"):
        reduce(long_chain, KEPT, method="krylov")


def test_the_method_follows_from_what_is_given(long_chain, tmp_path, capsys):
    path, out = str(tmp_path / "full.h5"), str(tmp_path / "small.h5")
    long_chain.write(path)
    words = ["reduce", path, "--keep", ",".join(KEPT), "-o", out, "--overwrite"]
    for more, up_to in ((["--up-to", "0.11"], 0.11), (["--up-to", "0.11", "--modes", "30"], None), ([], None)):
        assert main([*words, *more]) == 0
        assert Structure.read(out).up_to == up_to
    capsys.readouterr()
    assert main([*words, "--method", "krylov", "--up-to", "0.11", "--modes", "30"]) == 2
    assert "--modes belongs to the other methods" in capsys.readouterr().err
