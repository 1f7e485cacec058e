"""The response to small white noise about a motion: closed forms, and own Monte Carlo integrations of the nonlinear equations."""

import numpy as np
import pytest
from program import BAD_INPUT, read, run, solve
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

ONE_DOF = "&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = {damping}, stiffness = {stiffness} /\n"
DUFFING = (
    ONE_DOF.format(damping=0.1, stiffness=1.0)
    + """&tones frequency = {frequency} /
&load dof = 'x1', tuple = 1, cos = 0.3 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&noise dof = 'x1', intensity = 1e-6 /
&accuracy tolerance = 1e-5 /
"""
)


def variances(path):
    mean, peak, least = (
        values[0] for values in read(path, "noise_variance", "noise_peak_variance", "noise_least_variance")
    )
    return mean, peak, least


@pytest.mark.parametrize("damping", [1e-4, 0.3, 40.0])
@pytest.mark.parametrize("frequency", [0.01, 0.9, 30.0])
def test_linear_variance_is_that_of_equipartition(damping, frequency, tmp_path):
    """The variance is D/(c k) at all times, whatever the frequency of the motion."""
    text = f"""&structure type = 'matrices', n_dofs = 1, mass = 0.7, damping = {damping}, stiffness = 2.5 /
&tones frequency = {frequency} /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&noise dof = 'x1', intensity = 0.02 /
"""
    path = solve(text, tmp_path)
    for variance in variances(path):
        assert variance == pytest.approx(0.02 / (damping * 2.5), rel=1e-10)
    assert read(path, "noise_estimate")[0] < 1e-6


def test_sources_are_independent_unless_they_are_shared(tmp_path):
    mass, damping = np.diag([1.0, 2.0, 0.5]), np.diag([0.1, 0.02, 0.3])
    stiffness = np.array([[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 4.0]])
    forces = np.zeros((3, 2))
    forces[0, 0], forces[2, 0], forces[1, 1] = np.sqrt(2 * 0.1), -0.5 * np.sqrt(2 * 0.3), np.sqrt(2 * 0.2)
    inverse = np.linalg.inv(mass)
    a = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ stiffness, -inverse @ damping]])
    b = np.vstack([np.zeros((3, 2)), inverse @ forces])
    wanted = np.diag(solve_continuous_lyapunov(a, -b @ b.T))[:3]

    def listed(matrix):
        return ", ".join(str(value) for value in matrix.ravel())

    text = f"""&structure type = 'matrices', n_dofs = 3, mass = {listed(mass)}, damping = {listed(damping)},
   stiffness = {listed(stiffness)} /
&tones frequency = 1.1 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&noise dof = 'x1', intensity = 0.1, source = 1 /
&noise dof = 'x2', intensity = 0.2 /
&noise dof = 'x3', intensity = 0.3, source = 1, factor = -0.5 /
"""
    assert variances(solve(text, tmp_path))[0] == pytest.approx(wanted, rel=1e-10)


def test_first_order_coordinates(tmp_path):
    """A coordinate with damping alone, c x' + k x = f, has the variance D/(c k), too; one with neither follows at a distance."""
    text = """&structure type = 'matrices', n_dofs = 2, mass = 1.0, 0.0, damping = 0.1, 0.4, stiffness = 1.0, 0.0, 0.0, 2.0 /
&tones frequency = 1.1 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&noise dof = 'x2', intensity = 0.1 /
"""
    assert variances(solve(text, tmp_path))[0] == pytest.approx([0.0, 0.1 / (0.4 * 2.0)], rel=1e-10)


@pytest.mark.parametrize(("mass", "time"), [(1.0, 1.0), (1e9, 1e-6), (1e-12, 1e4)])
def test_variance_has_the_unit_of_the_displacement_squared(mass, time, tmp_path):
    """The Duffing oscillator in other units of mass and time."""
    force = mass / time**2
    text = f"""&structure type = 'matrices', n_dofs = 1, mass = {mass}, damping = {0.1 * mass / time}, stiffness = {force} /
&tones frequency = {0.8 / time} /
&load dof = 'x1', tuple = 1, cos = {0.3 * force} /
&law type = 'cubic_spring', dof = 'x1', stiffness = {force} /
&noise dof = 'x1', intensity = {1e-6 * force**2 * time} /
&accuracy tolerance = 1e-5 /
"""
    given = DUFFING.format(frequency=0.8)
    wanted = variances(solve(given, tmp_path, name="given"))
    assert np.ravel(variances(solve(text, tmp_path, name="other"))) == pytest.approx(np.ravel(wanted), rel=1e-6)


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_parametron_is_squeezed_to_a_half_at_threshold(share, tmp_path):
    """A stiffness pumped at twice the natural frequency: the quadratures have the variances V/(1 - g) and V/(1 + g), V = D/(c k),
    at the share g of the threshold. Corrections are of the order of the damping."""
    damping = 1e-3
    text = (
        ONE_DOF.format(damping=damping, stiffness=1.0)
        + f"""&tones frequency = 2.0 /
&law type = 'parametric', dof = 'x1', tuple = 1, stiffness_cos = {2 * damping * share} /
&noise dof = 'x1', intensity = {damping} /
&accuracy tolerance = 1e-6 /
"""
    )
    mean, peak, least = (values[0] for values in variances(solve(text, tmp_path)))
    assert least == pytest.approx(1 / (1 + share), rel=5 * damping)
    assert peak == pytest.approx(1 / (1 - share), rel=5 * damping)
    assert mean == pytest.approx(1 / (1 - share**2), rel=5 * damping)


def test_unstable_motions_have_no_variance(tmp_path):
    text = (
        ONE_DOF.format(damping=0.01, stiffness=1.0)
        + """&tones frequency = 2.0 /
&law type = 'parametric', dof = 'x1', tuple = 1, stiffness_cos = 0.1 /
&noise dof = 'x1', intensity = 1.0 /
"""
    )
    path = solve(text, tmp_path)
    assert np.isnan(variances(path)).all()
    assert status_of(path) == "unstable"


def status_of(path):
    import h5py

    with h5py.File(path) as file:
        number, names = file["noise_status"][0], file["noise_status"].attrs["flag_meanings"]
    return (names.decode() if isinstance(names, bytes) else names).split()[number]


def monte_carlo(force, frequency, intensity, damping, start, paths=4000, steps=256, periods=(30, 8), seed=1):
    """Mean over a period, largest and smallest variance of x'' + c x' + force(t, x, state) = noise, each with its standard error,
    by the weak scheme of second order of Heun; states of the force are advanced at each step."""
    rng = np.random.default_rng(seed)
    h = 2 * np.pi / frequency / steps
    x, v = np.full(paths, start[0]), np.full(paths, start[1])
    force.begin(x)
    squares = np.zeros((steps, paths))
    for period in range(sum(periods)):
        for k in range(steps):
            if period >= periods[0]:
                squares[k] += (x - x.mean()) ** 2 * paths / (paths - 1)
            t = (period + k / steps) * 2 * np.pi / frequency
            kick = rng.standard_normal(paths) * np.sqrt(2 * intensity * h)
            a = -damping * v - force.at(t, x)
            x_next, v_next = x + h * v, v + h * a + kick
            a_next = -damping * v_next - force.at(t + h, x_next)
            x, v = x + 0.5 * h * (v + v_next), v + 0.5 * h * (a + a_next) + kick
            force.advance(x)
    squares /= periods[1]
    course = squares.mean(axis=1)
    picked = [squares.mean(axis=0), squares[course.argmax()], squares[course.argmin()]]
    return [(values.mean(), values.std() / np.sqrt(paths)) for values in picked]


def torus(load, damping, tmp_path, name):
    """The Duffing oscillator under two tones."""
    text = (
        ONE_DOF.format(damping=damping, stiffness=1.0)
        + f"""&tones frequency = 0.8, 0.3090169943749474 /
&load dof = 'x1', tuple = 1, 0, cos = 0.3 /
&load dof = 'x1', tuple = 0, 1, cos = {load} /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&noise dof = 'x1', intensity = 1e-6 /
&accuracy tolerance = 1e-4 /
"""
    )
    return solve(text, tmp_path, name=name)


def test_a_second_tone_without_a_load_changes_nothing(tmp_path):
    path = torus(0.0, 0.1, tmp_path, "two")
    wanted = variances(solve(DUFFING.format(frequency=0.8), tmp_path, name="one"))
    assert np.ravel(variances(path)) == pytest.approx(np.ravel(wanted), rel=2e-3)
    assert read(path, "noise_estimate")[0] < 2e-3


def test_two_tones_against_monte_carlo(tmp_path):
    """The mean over 60 periods of the second tone, and the extremes there."""
    path = torus(0.3, 0.2, tmp_path, "two")
    slow, damping, intensity, paths, steps, periods = 0.3090169943749474, 0.2, 1e-6, 1500, 400, (6, 30)
    rng = np.random.default_rng(3)
    h = 2 * np.pi / slow / steps
    x, v = np.zeros(paths), np.zeros(paths)

    def force(t, x):
        return x + x**3 - 0.3 * np.cos(0.8 * t) - 0.3 * np.cos(slow * t)

    total, course = np.zeros(paths), []
    for k in range(steps * sum(periods)):
        if k >= steps * periods[0]:
            squares = (x - x.mean()) ** 2 * paths / (paths - 1)
            total += squares
            course.append(squares.mean())
        kick = rng.standard_normal(paths) * np.sqrt(2 * intensity * h)
        a = -damping * v - force(k * h, x)
        x_next, v_next = x + h * v, v + h * a + kick
        x, v = x + 0.5 * h * (v + v_next), v + 0.5 * h * (a - damping * v_next - force((k + 1) * h, x_next)) + kick
    total /= len(course)
    mean, peak, least = (values[0] for values in variances(path))
    assert total.std() / np.sqrt(paths) < 0.02 * mean
    assert abs(mean - total.mean()) < 4 * total.std() / np.sqrt(paths) + 0.005 * mean
    of_one_time = np.sqrt(2 / paths)  # relative standard error of a variance; the extremes of many such are wider apart
    assert abs(max(course) - peak) < 6 * of_one_time * peak
    assert abs(min(course) - least) < 6 * of_one_time * least


class Force:
    """A force on the left-hand side without memory."""

    def __init__(self, law, load, frequency):
        self.law, self.load, self.frequency = law, load, frequency

    def begin(self, x):
        pass

    def at(self, t, x):
        return self.law(x) - self.load * np.cos(self.frequency * t)

    def advance(self, x):
        pass


class Slider(Force):
    """With a spring in series with a slider (Jenkins)."""

    def __init__(self, stiffness, limit, law, load, frequency):
        super().__init__(law, load, frequency)
        self.stiffness, self.reach = stiffness, limit / stiffness

    def begin(self, x):
        self.place = np.zeros_like(x)

    def at(self, t, x):
        return super().at(t, x) + self.stiffness * np.clip(x - self.place, -self.reach, self.reach)

    def advance(self, x):
        self.place = np.clip(self.place, x - self.reach, x + self.reach)


def compare(path, expected):
    """Within four standard errors, which are at most 4 % of the variances."""
    for found, (value, error) in zip(variances(path), expected, strict=True):
        assert error < 0.04 * value
        assert abs(found[0] - value) < 4 * error + 0.005 * value  # steps of the integration


def start_of(path):
    """Displacement and velocity at t = 0, from the coefficients."""
    coefficients, frequency = (values[0] for values in read(path, "coefficients", "frequency"))
    tuples = read(path, "tuples")[0, :, 0]
    return coefficients[0, :, 0].sum(), (tuples * frequency[0] * coefficients[0, :, 1]).sum()


def test_duffing_oscillator_against_monte_carlo(tmp_path):
    path = solve(DUFFING.format(frequency=0.8), tmp_path)
    force = Force(lambda x: x + x**3, 0.3, 0.8)
    compare(path, monte_carlo(force, 0.8, 1e-6, 0.1, start_of(path)))


def test_elastic_stop_against_monte_carlo(tmp_path):
    text = (
        ONE_DOF.format(damping=0.2, stiffness=1.0)
        + """&tones frequency = 0.9 /
&load dof = 'x1', tuple = 1, cos = 0.4 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 5.0, gap = 0.5 /
&noise dof = 'x1', intensity = 1e-7 /
&accuracy tolerance = 1e-4 /
"""
    )
    path = solve(text, tmp_path)
    force = Force(lambda x: x + 5 * np.maximum(x - 0.5, 0), 0.4, 0.9)
    compare(path, monte_carlo(force, 0.9, 1e-7, 0.2, start_of(path), steps=512))


def test_friction_against_monte_carlo(tmp_path):
    text = (
        ONE_DOF.format(damping=0.2, stiffness=1.0)
        + """&tones frequency = 0.9 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&law type = 'jenkins', dof = 'x1', stiffness = 2.0, limit = 0.5 /
&noise dof = 'x1', intensity = 1e-7 /
&accuracy tolerance = 1e-4 /
"""
    )
    path = solve(text, tmp_path)
    force = Slider(2.0, 0.5, lambda x: x, 1.0, 0.9)
    compare(path, monte_carlo(force, 0.9, 1e-7, 0.2, start_of(path), steps=512))


def test_phase_of_a_limit_cycle_diffuses(tmp_path):
    """A van der Pol oscillator of small strength mu and amplitude 2: var(phase) grows at D/a**2, the radius has the variance
    D/(2 mu). Corrections are of the order of mu**2."""
    mu, intensity = 0.02, 1e-6
    text = f"""&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0 /
&tones unknown = .true., frequency = 1.0 /
&law type = 'van_der_pol', dof = 'x1', strength = {mu} /
&start dof = 'x1', tuple = 1, cos = 2.0 /
&noise dof = 'x1', intensity = {intensity} /
&accuracy tolerance = 1e-6 /
"""
    path = solve(text, tmp_path)
    assert read(path, "phase_diffusion")[0, 0] == pytest.approx(intensity / 4, rel=2 * mu**2 + 1e-5)
    mean, peak, _ = (values[0] for values in variances(path))
    assert mean == pytest.approx(intensity / (4 * mu), rel=4 * mu)
    assert peak == pytest.approx(intensity / (2 * mu), rel=4 * mu)


@pytest.mark.parametrize("mu", [0.2, 1.0, 3.0])
def test_noise_about_a_limit_cycle_is_that_of_its_floquet_vectors(mu, tmp_path):
    """In a plane: with the vector Z of the multiplier 1 of the adjoint equations, Z . f = omega, the phase diffuses at the mean of
    2 D Z_2**2; the rest of the noise is a multiple of the other vector, whose displacement vanishes twice in a period."""
    text = f"""&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0 /
&tones unknown = .true. /
&law type = 'van_der_pol', dof = 'x1', strength = {mu} /
&noise dof = 'x1', intensity = 1e-6 /
&accuracy tolerance = 1e-6 /
"""
    path = solve(text, tmp_path)

    def rate(t, y):
        return [y[1], mu * (1 - y[0] ** 2) * y[1] - y[0]]

    options = {"rtol": 1e-10, "atol": 1e-12, "method": "DOP853"}
    period = 2 * np.pi / read(path, "frequency")[0, 0]
    begin = solve_ivp(rate, (0, 40 * period), [2.0, 0.0], **options).y[:, -1]
    orbit = solve_ivp(rate, (0, period), begin, dense_output=True, **options).sol

    def adjoint(t, z):  # backwards in time, where other vectors decay
        x, v = orbit(-t % period)
        return [-(1 + 2 * mu * x * v) * z[1], z[0] + mu * (1 - x**2) * z[1]]

    times = np.linspace(5 * period, 6 * period, 2001)
    z = solve_ivp(adjoint, (0, 6 * period), [1.0, 1.0], t_eval=times, **options).y
    z *= 2 * np.pi / period / (z[:, -1] @ rate(0, orbit(0)))
    assert read(path, "phase_diffusion")[0, 0] == pytest.approx(2e-6 * np.trapz(z[1] ** 2, times) / period, rel=1e-3)
    mean, peak, least = (values[0] for values in variances(path))
    assert least < 1e-3 * mean < peak


def test_spectrum_of_a_linear_oscillator(tmp_path):
    """4 D |H|**2 per hertz, at, below and above resonance."""
    text = (
        ONE_DOF.format(damping=0.05, stiffness=1.0)
        + """&tones frequency = 0.7 /
&load dof = 'x1', tuple = 1, cos = 1.0 /
&noise dof = 'x1', intensity = 0.3 /
&sweep parameter = 'stability%noise_frequency', values = 0.0, 0.5, 1.0, 1.1, 3.0 /
"""
    )
    frequency = np.array([0.0, 0.5, 1.0, 1.1, 3.0])
    wanted = 4 * 0.3 / abs(1 - frequency**2 + 0.05j * frequency) ** 2
    assert read(solve(text, tmp_path), "noise_spectrum")[:, 0] == pytest.approx(wanted, rel=1e-3)


def test_spectrum_of_a_duffing_oscillator_has_its_sidebands(tmp_path):
    """Against the harmonic transfer functions of the equation linearised about the motion: what noise at all frequencies w + k W
    contributes at w."""
    frequency = np.array([0.2, 0.55, 1.05, 1.6, 2.7])
    text = DUFFING.format(frequency=0.8) + "&sweep parameter = 'stability%noise_frequency', values = "
    path = solve(text + ", ".join(map(str, frequency)) + " /\n", tmp_path)
    coefficients, tuples = read(path, "coefficients")[0, 0], read(path, "tuples")[0, :, 0]
    phase = 2 * np.pi * np.arange(256) / 256
    x = np.cos(np.outer(phase, tuples)) @ coefficients[:, 0] + np.sin(np.outer(phase, tuples)) @ coefficients[:, 1]
    slope = np.fft.fft(3 * x**2) / 256
    sidebands = np.arange(-20, 21)
    for w, found in zip(frequency, read(path, "noise_spectrum")[:, 0], strict=True):
        shifted = w + 0.8 * sidebands
        hill = np.diag(1 - shifted**2 + 0.1j * shifted) + slope[sidebands[:, None] - sidebands[None, :]]
        response = np.linalg.inv(hill)[20]
        assert found == pytest.approx(4e-6 * (abs(response) ** 2).sum(), rel=1e-3)


def test_noise_is_swept_as_any_number(tmp_path):
    text = DUFFING.format(frequency=0.8) + "&sweep parameter = 'noise(1)%intensity', values = 0.0, 1e-6, 3e-6 /\n"
    found = read(solve(text, tmp_path), "noise_variance")[:, 0]
    assert found[0] == 0.0
    assert found[2] == pytest.approx(3 * found[1], rel=1e-9)


@pytest.mark.parametrize(
    ("rest", "status"),
    [
        ("&law type = 'rigid_wall', dof = 'x1', gap = 0.1 /\n&tones frequency = 0.9 /\n", "no_verdict"),
        ("&law type = 'coulomb_rigid', dof = 'x1', limit = 0.05 /\n&tones frequency = 0.9 /\n", "no_equations"),
        (
            "&law type = 'van_der_pol', dof = 'x1', strength = 0.5 /\n&tones frequency = 1.2, 0.9, unknown = .false., .true. /\n",
            "several_tones",
        ),
    ],
)
def test_what_is_not_known_has_a_reason(rest, status, tmp_path):
    tuple_ = "1, 0" if "unknown" in rest else "1"
    text = (
        ONE_DOF.format(damping=0.1, stiffness=1.0)
        + rest
        + f"&load dof = 'x1', tuple = {tuple_}, cos = 0.2 /\n&noise dof = 'x1', intensity = 1e-6 /\n&accuracy tolerance = 1e-3 /\n"
    )
    path = solve(text, tmp_path, status=None)
    assert np.isnan(variances(path)).all()
    assert status_of(path) == status


@pytest.mark.parametrize("rest", ["&stability method = 'off' /\n", "&normal_mode amplitude = 0.1, dof = 'x1' /\n"])
def test_noise_needs_a_stability(rest, tmp_path):
    text = DUFFING.format(frequency=0.8) + rest
    if "normal" in rest:
        text = text.replace("&load dof = 'x1', tuple = 1, cos = 0.3 /\n", "").replace("damping = 0.1, ", "")
        text = text.replace("frequency = 0.8", "frequency = 0.8, unknown = .true.")
    (tmp_path / "input.nml").write_text(text)
    done = run("solve", "input.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert "intensity" in done.stderr
    assert "&noise" in done.stderr


def test_python_has_the_variances(tmp_path):
    nhbm = pytest.importorskip("nhbm")
    text = DUFFING.format(frequency=0.8)
    wanted = variances(solve(text, tmp_path))[0]
    model = nhbm.Model.from_namelist(text.replace("&noise dof = 'x1', intensity = 1e-6 /\n", ""))
    assert "noise_variance" not in model.solve()
    model.add("noise", dof="x1", intensity=1e-6)
    found = model.solve()
    assert found["noise_variance"].values == pytest.approx(wanted, rel=1e-9)
    assert found["noise_variance"].attrs["units"] == "m2"
    assert str(found["noise_status"].values) == "known"
