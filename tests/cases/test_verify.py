"""`nhbm verify`: motions of a result file against time integration."""

from __future__ import annotations

import resource
from pathlib import Path

import h5py
import numpy as np
import pytest

from integrations import FORCED, FREE, INPUTS, forced_blades
from program import BAD_INPUT, INCOMPLETE, NOT_ALL_CONVERGED, checksum_of_row, read, run, solve


def verified(result: Path, *options, status=0) -> dict[str, np.ndarray]:
    done = run("verify", result, *options, cwd=result.parent)
    assert done.status == status, done.stderr + done.stdout
    names = ("integration_verdict", "integration_first_difference", "integration_difference", "integration_growth")
    return dict(zip(names, read(result, *names)))


AGREES, UNSTABLE, DIFFERS, UNDECIDED = 1, 2, 3, 4
CONVERGED_CUBIC = FORCED.replace("order=3", "order=15")


def test_verify_agrees_with_a_converged_motion(tmp_path):
    found = verified(solve(CONVERGED_CUBIC, tmp_path))
    assert found["integration_verdict"] == [AGREES]
    assert found["integration_difference"][0] < 1e-9


@pytest.mark.parametrize("damping", ["0.1, -0.05, -0.05, 0.1", "0.1, 0, 0, 0"], ids=["damped", "undamped"])
@pytest.mark.parametrize("mass", [1e-12, 1e-18])
def test_a_tiny_mass_is_verified_like_none(mass, damping, tmp_path):
    """Its own vibration has 1e5 to 1e10 cycles in a period of the tone, which explicit steps would follow."""
    text = (
        f"&structure type='matrices', n_dofs=2, mass=1.0, 0, 0, {mass}, damping={damping}, stiffness=2.0, -1, -1, 2 /\n"
        "&tones frequency=0.9 /\n&load dof='x1', tuple=1, cos=0.3 /\n&law type='cubic_spring', dof='x1', stiffness=0.5 /\n"
    )
    began = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    assert verified(solve(text, tmp_path))["integration_verdict"] == [AGREES]
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - began < 30.0  # of steps without end


SLIDERS = {
    "bouc_wen": "&law type='bouc_wen', dof='x1', stiffness=1.0, yield_displacement=0.2 /\n",
    "jenkins_2d": "&law type='jenkins_2d', dof='x1', second_dofs='x2', stiffness=1.0, limit=0.1 /\n",
}


@pytest.mark.parametrize("slider", [pytest.param(k, marks=[pytest.mark.long] if k == "jenkins_2d" else []) for k in SLIDERS])
def test_sliders_beside_rigid_friction_are_verified(slider, tmp_path):
    """CVODE has no such sliders and Runge-Kutta methods no rigid laws: central differences have both."""
    text = (
        "&structure type='matrices', n_dofs=2, mass=1.0, 1.0, damping=0.1, 0, 0, 0.1, stiffness=2.0, -1, -1, 2 /\n"
        "&tones frequency=1.3 /\n&accuracy tolerance=1e-3 /\n&load dof='x1', tuple=1, cos=0.5 /\n"
        "&law type='coulomb_rigid', dof='x2', limit=0.05 /\n"
    )
    result = solve(text + SLIDERS[slider], tmp_path)
    assert verified(result)["integration_verdict"] == [AGREES]
    with h5py.File(result, "r+") as file:
        file["coefficients"][0, :, file["tuples"][0, :, 0].tolist().index(1), :] *= 1.05
        file["checksum"][0] = checksum_of_row(file, 0)
    assert verified(result, status=NOT_ALL_CONVERGED)["integration_verdict"] == [DIFFERS]


STIFF_CHAIN = (
    "&structure type='chain', n_masses=510, mass=1.0, coupling_stiffness=1e8, damping_mass=40.0 /\n&tones frequency=40.0 /\n"
    "&load dof='x10', tuple=1, cos=3e5 /\n&law type='bouc_wen', dof='x12', stiffness=1e3, yield_displacement=1e-3 /\n"
)


@pytest.mark.long
def test_verify_resolves_the_fastest_mode_of_a_large_structure(tmp_path):
    """Steps of a hysteresis follow the fastest mode, 2e4 rad/s, of 510 masses."""
    assert verified(solve(STIFF_CHAIN, tmp_path), "--periods", "3")["integration_verdict"] == [AGREES]


def test_the_time_limit_of_verify_holds_within_one_sample(tmp_path):
    """A sample of the motion is ten thousands of steps, some minutes."""
    result = solve(STIFF_CHAIN.replace("frequency=40.0", "frequency=0.3"), tmp_path)
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    assert run("verify", result, "--time-limit", "1", cwd=tmp_path).status == INCOMPLETE
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before < 20.0


@pytest.mark.parametrize("ranks", [1, 2])
def test_verify_counts_its_points(tmp_path, ranks):
    result = solve(CONVERGED_CUBIC + "&sweep parameter='load%cos', from=0.1, to=0.3, n=3 /\n", tmp_path)
    done = run("verify", result, "--points", "0,2", cwd=tmp_path, ranks=ranks)
    assert done.stderr.splitlines()[-1].startswith("2/2 points, ")
    *points, summary = done.stdout.splitlines()
    assert [line.split(":")[0] for line in points] == ["point 0", "point 2"] and summary == "2 points verified: 2 agrees"
    assert run("verify", result, "--points", "0", "--quiet", cwd=tmp_path).stderr == ""


def test_a_motion_that_verify_finds_unstable_has_a_verdict(tmp_path):
    """Two modes against a stop that grow 3700 times within a period: shooting from a motion that is accurate to 1e-3 is lost."""
    text = "&structure type='modal_beam', length=1.0, bending_stiffness=0.010265982254684338, mass_per_length=1.0, n_modes=2,\n"
    text += "damping_mass=0.06792138905272184 /\n&tones frequency=1.247834592504061 /\n&accuracy tolerance=0.01 /\n"
    text += "&law type='elastic_stop', dofs='q1','q2', weights=0.9445130839479713,-0.6204955949402001,\n"
    text += "stiffness=101.86792560989628, gap=0.01582907678200261, two_sided=.true. /\n"
    text += "&load dof='q2', tuple=1, cos=-0.9859130164252845, sin=-0.05491702660334894 /\n"
    result = solve(text, tmp_path, "--set", "stability%method='integration'")
    stable, n_unstable, growth = read(result, "is_stable", "n_unstable", "exponent")
    assert (stable, n_unstable) == ([-1], [2])
    assert growth[0, 0] > 0.5 and growth[0, 1] == pytest.approx(np.log(2.186) * 1.2478 / (2 * np.pi), rel=0.3)
    assert verified(result, status=NOT_ALL_CONVERGED)["integration_verdict"] == [UNSTABLE]


CASCADE = """&structure type='matrices', n_dofs=3, mass=1,0,0,0,1,0,0,0,1, damping=0.004,0,0,0,0.004,0,0,0,0.004,
   stiffness=1,0.3,0,0,1,0.3,0,0,1 /
&tones frequency=0.7 /
&harmonics order=5 /
&load dof='x1', tuple=1, cos=0.1 /
&law type='cubic_spring', dof='x1', stiffness=0.01 /
"""


def test_growth_before_a_decay_is_not_unstable(tmp_path):
    """Each oscillator drives the next one at resonance: disturbances grow 1500 times in 110 periods, and decay afterwards."""
    result = solve(CASCADE, tmp_path)
    assert read(result, "is_stable")[0] == [1]
    assert verified(result)["integration_verdict"] == [AGREES]


@pytest.mark.long
def test_growth_without_a_decay_is_unstable(tmp_path):
    """Whatever is claimed: without a verdict of the file the integration goes on for longer."""
    text = CASCADE.replace("0.004,0,0,0,0.004,0,0,0,0.004", "0.004,0,0,0,0.004,0,0,0,-0.004")
    for method in ("auto", "off"):
        result = solve(text, tmp_path, "--set", f"stability%method='{method}'", name=method)
        assert verified(result, status=NOT_ALL_CONVERGED)["integration_verdict"] == [UNSTABLE]


def test_motions_far_below_the_length_of_a_law_agree(tmp_path):
    """Nanometres, where the damping changes its sign at a metre: tolerances of the integration are those of the motion."""
    text = """&structure type='matrices', n_dofs=2, mass=118.61591, 0, 0, 118.61591, damping=3.0830348e+08, 0, 0, 3.0830348e+08,
   stiffness=8.2929844e+16, -3.9166356e+16, -3.9166356e+16, 8.7519879e+16 /
&tones frequency=16073824 /
&load dof='x1', tuple=1, cos=3.2588995e+08 /
&load dof='x1', tuple=0, cos=4.0337009e+08 /
&law type='van_der_pol', dof='x1', strength=2.4257045e+08 /
"""
    assert verified(solve(text, tmp_path))["integration_verdict"] == [AGREES]


def test_a_nearly_free_body_that_drifts_is_not_unstable(tmp_path):
    """Its disturbances grow like time for thousands of periods, and decay afterwards, as its multipliers do."""
    text = """&structure type='matrices', n_dofs=3, mass=1, 0, 0, 0, 1, 0, 0, 0, 1,
   damping=0.027029625, -0.025719663, 0, -0.025719663, 0.059855578, -0.034135914, 0, -0.034135914, 0.034135914,
   stiffness=0.51439339, -0.51439327, 0, -0.51439327, 1.1971116, -0.68271828, 0, -0.68271828, 0.68271828 /
&tones frequency=1.6153 /
&load dof='x3', tuple=1, cos=0.528128 /
&law type='elastic_stop', dof='x3', stiffness=6.6117, gap=0.3746, two_sided=.true. /
"""
    result = solve(text, tmp_path)
    assert read(result, "is_stable")[0] == [1]
    done = run("verify", result, "--periods", "600", cwd=tmp_path)
    assert "unstable" not in done.stdout, done.stdout


def test_verify_integrates_again_what_was_integrated_with_a_set_of_its_own(tmp_path):
    """Ueda's oscillator without a balance: the file has as many elements as its largest set, the first point uses six of ten."""
    text = "&structure type='matrices', n_dofs=1, mass=1, damping=0.1, stiffness=0 /\n&tones frequency=1 /\n&harmonics order=9 /\n"
    text += "&load dof='x1', tuple=1, cos=1 /\n&law type='cubic_spring', dof='x1', stiffness=1 /\n"
    text += "&solver max_iterations=0, homotopy_iterations=0 /\n&sweep parameter='harmonics%order', values=5, 9 /\n"
    result = solve(text, tmp_path, status=None)
    assert (read(result, "status")[0] == 18).all()  # integrated
    assert (verified(result)["integration_verdict"] == AGREES).all()


@pytest.mark.long
def test_verify_passes_spare_rows_of_a_curve_in_silence(tmp_path):
    text = "&structure type='matrices', n_dofs=1, mass=1, damping=0.5, stiffness=1 /\n&tones frequency=1 /\n&harmonics order=9 /\n"
    text += "&load dof='x1', tuple=1, cos=1 /\n&law type='cubic_spring', dof='x1', stiffness=0.1 /\n"
    text += "&curve parameter='tones%frequency', from=1.0, to=1.1, points=60 /\n"
    result = solve(text, tmp_path, status=None)
    n = int((read(result, "status") == 1).sum())
    assert 2 <= n < 50
    lines = run("verify", result, cwd=tmp_path).stdout.splitlines()
    assert len(lines) == n + 1 and lines[-1].startswith(f"{n} points verified")
    assert "point 59: skipped, it has no motion" in run("verify", result, "--points", "0,59", cwd=tmp_path).stdout
    text = run("verify", result, "--points", "58,59", cwd=tmp_path).stdout
    assert text.startswith("2 points skipped (first: point 58), they have no motion to start from: unused")


def test_verify_sees_a_coefficient_that_is_wrong_by_a_thousandth(tmp_path):
    result = solve(CONVERGED_CUBIC, tmp_path)
    with h5py.File(result, "r+") as file:
        file["coefficients"][0, 0, file["tuple"][:, 0].tolist().index(1), 0] *= 1.001
        file["checksum"][0] = checksum_of_row(file, 0)  # as if it had been found in this way
    found = verified(result, status=NOT_ALL_CONVERGED)
    assert found["integration_verdict"] == [DIFFERS]
    assert 2e-4 < found["integration_first_difference"][0] < 5e-3


def test_verify_knows_an_unstable_motion_from_a_wrong_one(tmp_path):
    """A van der Pol oscillator under a small load: the small motion is a solution, with a growth rate near strength/2."""
    law = "&load dof='x1', tuple=1, cos=0.05 /\n&law type='van_der_pol', dof='x1', strength=0.3 /\n"
    text = FREE.replace("&tones frequency=1", "&tones frequency=2").replace("order=1", "order=9") + law
    found = verified(solve(text, tmp_path), "--periods", 50, status=NOT_ALL_CONVERGED)
    assert found["integration_verdict"] == [UNSTABLE]
    assert found["integration_first_difference"][0] < 1e-10
    assert found["integration_growth"][0] == pytest.approx(0.15, rel=0.1)


@pytest.mark.long  # seconds
def test_verify_takes_friction_and_chosen_points_on_two_ranks(tmp_path):
    text = (INPUTS / "gallery" / "jenkins_two_tones.nml").read_text()
    result = solve(text, tmp_path)
    done = run("verify", result, "--points", "1,2", cwd=tmp_path, ranks=2)
    assert done.status == 0, done.stderr
    kinds, largest = read(result, "integration_verdict", "integration_difference")
    assert kinds.tolist() == [0, AGREES, AGREES]
    # Runge and Kutta's method in steps of 1 ms departs by up to 4.6e-2 and 1.6e-2 of the motion within 500 s
    assert np.isnan(largest[0]) and largest[1] < 5e-2 and 1e-2 < largest[2] < 1.8e-2


# Converged motions from which a time integration departs; that of another program (tests/campaigns/points) ends at the given
# distance from them.
DEPARTING = {
    "grows slowly": (
        UNSTABLE,
        """
&structure type='chain', n_masses=2, mass=0.4975, 2.638, coupling_stiffness=0.7854, 1.2364, 0.9657, damping_stiffness=0.012955 /
&tones frequency=1.6141943 /
&harmonics order=21 /
&law type='cubic_spring', dof='x1', stiffness=1.98058 /
&law type='coulomb_tanh', dof='x1', limit=0.136304, velocity=0.0595164 /
&load dof='x1', tuple=1, cos=0.965677, sin=0.18018 /
""",
    ),  # 110 % of the motion of x1
    "grows more slowly than the structure forgets": (
        UNSTABLE,
        """
&structure type='modal_beam', length=1.0, bending_stiffness=0.010265982254684338, mass_per_length=1.0, n_modes=2,
   damping_stiffness=0.0414588 /
&tones frequency=1.6847037733 /
&harmonics order=7 /
&law type='coulomb_rigid', dofs='q1','q2', weights=0.985860607,0.330396373, limit=0.0845810128 /
&law type='cubic_spring', dofs='q1','q2', weights=0.908617370,-0.758930999, stiffness=9.29254771 /
&load dof='q1', tuple=1, cos=-0.453907734, sin=-0.467877773 /
""",
    ),  # 25 % of the motion of the friction
    "two stops": (
        UNSTABLE,
        """
&structure type='matrices', n_dofs=1, mass=1.90222, stiffness=11.39946, damping_stiffness=0.005401 /
&tones frequency=1.36007445 /
&harmonics order=16 /
&law type='elastic_stop', dof='x1', stiffness=483.645, gap=0.070841 /
&law type='elastic_stop', dof='x1', stiffness=113.038, gap=0.073506 /
&load dof='x1', tuple=1, cos=-0.154108, sin=0.764477 /
""",
    ),  # 95 %; with order 120 it is accurate to 1e-4, and departs at the same rate
    "two tones": (
        DIFFERS,
        """
&structure type='matrices', n_dofs=1, mass=1.62884, stiffness=5.06897, damping_mass=0.309476 /
&tones frequency=3.80818, 8.54107 /
&harmonics order=5 /
&law type='cubic_spring', dof='x1', stiffness=3780.877 /
&load dof='x1', tuple=1,0, cos=0.773091, sin=0.513342 /
&load dof='x1', tuple=0,1, cos=-0.477488, sin=0.840491 /
""",
    ),  # 59 %
    "wall between two masses": (
        DIFFERS,
        """
&structure type='chain', n_masses=3, mass=1.110137, 1.115973, 1.58035671, coupling_stiffness=2.07388, 0.335519, 2.29986, 0.327054,
   damping_mass=0.00463875 /
&tones frequency=1.04542795 /
&harmonics order=19 /
&law type='rigid_wall', dofs='x1','x2', weights=1.0,-1.0, gap=0.291549 /
&load dof='x1', tuple=1, cos=-0.39093, sin=-0.348957 /
""",
    ),  # 66 %
}


@pytest.mark.parametrize("name", DEPARTING)
def test_verify_sees_motions_from_which_integration_departs(tmp_path, name):
    expected, text = DEPARTING[name]
    result = solve(text, tmp_path, status=None)
    found = verified(result, status=NOT_ALL_CONVERGED)
    assert found["integration_verdict"] == [expected], found
    names = ("integration_growth", "integration_limit", "integration_duration", "frequency")
    growth, limit, duration, frequency = read(result, *names)
    assert limit <= 0.1 and duration >= 20 * 2 * np.pi / frequency.min() * (1 - 1e-12)
    if expected == DIFFERS:
        assert found["integration_difference"] > 0.3
    else:
        assert growth * duration > 3.0


@pytest.mark.long
def test_verify_is_as_long_as_the_slowest_decay_needs_by_default(tmp_path):
    """With 0.1 % of damping ten periods show nothing, and 700 are sufficient."""
    light = "&structure type='matrices', n_dofs=1, mass=1, damping=0.002, stiffness=1 /\n&tones frequency=1.2 /\n"
    text = light + "&harmonics order=7 /\n&load dof='x1', tuple=1, cos=0.1 /\n&law type='cubic_spring', dof='x1', stiffness=0.5 /\n"
    result = solve(text, tmp_path)
    assert verified(result, "--periods", 10, status=NOT_ALL_CONVERGED)["integration_verdict"] == [UNDECIDED]
    assert read(result, "integration_duration")[0] == pytest.approx(10 * 2 * np.pi / 1.2)
    assert verified(result)["integration_verdict"] == [AGREES]
    assert np.log(100) / 0.001 < read(result, "integration_duration")[0] < 1.3 * np.log(100) / 0.001


def test_disturbances_of_a_motion_that_agrees_decay(tmp_path):
    """Its difference exceeds the limit in the transient: growth is that of all periods, by the multipliers -0.6/s."""
    text = "&structure type='chain', n_masses=2, mass=2.0, 0.7, ends='fixed-free', coupling_stiffness=5000.0, 1500.0,\n"
    text += "           damping_stiffness=4e-4, damping_mass=0.3 /\n&tones hertz=8.0 /\n&load dof='x1', tuple=1, cos=8.0 /\n"
    text += "&law type='elastic_stop', label='stop', dof='x2', stiffness=3.0e4, gap=3e-3 /\n"
    found = verified(solve(text, tmp_path))
    assert found["integration_verdict"] == [AGREES] and found["integration_growth"][0] == pytest.approx(-0.6, abs=0.2)


def test_verify_needs_all_degrees_of_freedom(tmp_path):
    two = "&structure type='chain', n_masses=2, mass=1, coupling_stiffness=1 /\n&tones frequency=3 /\n&harmonics order=1 /\n"
    result = solve(two + "&load dof='x1', tuple=1, cos=1 /\n&output dofs='x1' /\n", tmp_path)
    done = run("verify", result, cwd=tmp_path)
    assert done.status == BAD_INPUT and "1 of 2; solve again" in done.stderr


@pytest.mark.long
@pytest.mark.parametrize("method", ["cvode", "central_differences"])
def test_verify_starts_from_a_motion_that_is_partly_behind_a_wall(tmp_path, method):
    """Both tones have their maximum at t = 0, where the series of order 5 is 3e-5 m beyond the wall."""
    text = (INPUTS / "paper" / "wall.nml").read_text()
    result = solve(
        text[: text.index("&sweep")], tmp_path, "--set", "harmonics%order=5", "--set", "sampling%samples=32", "--set",
        f"integration%method='{method}'", status=None,
    )  # fmt: skip
    found = verified(result, "--points", 0, "--periods", 7)  # a whole beat of both tones: a shorter time decides nothing
    assert found["integration_verdict"] == [AGREES]
    assert 2e-2 < found["integration_first_difference"][0] < 6e-2  # of the motion of the wall's coordinate


@pytest.mark.parametrize("frame", ["own", "stationary"])
def test_verify_agrees_with_blades_that_run_along_the_casing(tmp_path, frame):
    result = solve(forced_blades(frame, 9), tmp_path)
    found = verified(result)
    assert found["integration_verdict"] == [AGREES] and found["integration_first_difference"][0] < 1e-3, found


def test_the_motion_that_an_unstable_balance_leads_to_is_the_answer(tmp_path):
    """The series of the balance, 0.1 beside an unstable motion, reaches no tolerance; every start ends in the other motion."""
    text = "&structure type='matrices', n_dofs=1, mass=1.47e-3, damping=2.4e-3, stiffness=7.08 /\n&tones frequency=42.3 /\n"
    text += "&load dof='x1', tuple=1, cos=0.44 /\n&law type='cubic_spring', dof='x1', stiffness=3240 /\n"
    text += "&law type='hertz', dof='x1', stiffness=30310, exponent=1.5, gap=0.00727 /\n"
    result = solve(text, tmp_path)
    status, stable = read(result, "status", "is_stable")
    assert list(status) == [18] and list(stable) == [1]  # integrated
    assert verified(result)["integration_verdict"] == [AGREES]


def test_verify_agrees_where_the_basin_is_smaller_than_the_error(tmp_path):
    """Eight contacts in a period, multipliers -.7265 +- .6317i by exact shooting; disturbances of 3e-3, the error of the series,
    diverge (`tests/campaigns/workflows --seed 961430816 --first 9`). The neighbour is unstable: integration would replace it."""
    text = "&structure type='modal_beam', length=1.0, bending_stiffness=0.010265982254684338, mass_per_length=1.0, n_modes=1,\n"
    text += "damping_mass=0.005246432155835139 /\n&tones frequency=0.43447070654402514 /\n"
    text += "&law type='elastic_stop', dofs='q1', weights=0.9982940737339058, stiffness=4.8, gap=0.5571072182761566 /\n"
    text += "&load dof='q1', tuple=1, cos=0.43562811602173934 /\n"
    text += "&sweep parameter='law(1)%stiffness', from=145.8166746351207, to=0.1458166746351207, n=24, spacing='log' /\n"
    result = solve(text, tmp_path, "--set", "solver%fallback_by_integration=.false.", status=None)
    stable, multipliers = read(result, "is_stable", "multiplier_real")
    assert stable[1] == 1 and multipliers[1] == pytest.approx([-0.7265306, -0.7265306], abs=1e-6)
    done = run("verify", result, "--points", "1", cwd=tmp_path)
    assert done.status == 0 and "agrees with time integration that starts on the periodic motion" in done.stdout, done.stdout


@pytest.mark.long
def test_verify_knows_unstable_motions_of_coordinates_without_mass(tmp_path):
    """Implicit steps have errors of 1e-6, far above those of the motion: behind the fold they grow, elsewhere they do not."""
    text = "&structure type='matrices', n_dofs=3, mass=1,0,0, 0,0,0, 0,0,1.3, damping=.05,0,0, 0,.2,0, 0,0,.04,\n"
    text += "stiffness=2,-1,0, -1,2.5,-.8, 0,-.8,1.9 /\n&tones frequency=1.1 /\n"
    text += "&law type='cubic_spring', dof='x1', stiffness=.8 /\n"
    text += "&load dof='x3', tuple=1, cos=.5 /\n&curve parameter='tones%frequency', from=1.4, to=1.6 /\n"
    result = solve(text, tmp_path)
    kind, stable = read(result, "curve_kind", "is_stable")
    first, second = np.flatnonzero(kind == 3)
    points = [0, (first + second) // 2]
    assert list(stable[points]) == [1, -1]
    found = verified(result, "--points", ",".join(map(str, points)), status=NOT_ALL_CONVERGED)["integration_verdict"]
    assert list(found[points]) == [AGREES, UNSTABLE]
