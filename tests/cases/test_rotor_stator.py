"""Blades against a casing: a limit cycle found by integration in time has no residual in the balance, in either frame.

The equations are written out a second time here, from the model and not from the program, and integrated by the classical
Runge-Kutta method; a period that repeats is found by shooting. Newton does not get to move anything: the program only
evaluates the residual of these coefficients.
"""

import numpy as np
import pytest

from program import read, solve

DISK, CASING, ZETA, CUBIC, GAP, CONTACT, ARMS, DIAMETERS, BLADES = 1.0, 1.7, 2e-3, 1e-3, 1.0, 2.0, (0.3, 1.0 / 3.0), 3, 22
CRITICAL = (DISK + CASING) / DIAMETERS
ANGLES = DIAMETERS * 2.0 * np.pi * np.arange(1, BLADES + 1) / BLADES
RADIAL = np.array([np.cos(ANGLES), np.sin(ANGLES)])
TANGENTIAL = np.array([-np.sin(ANGLES), np.cos(ANGLES)])

# Friction, speed; frequency and mean radii of disk and casing from time integration with ever smaller steps; phase between both.
CYCLES = {
    "frictionless": (0.0, 1.01 * CRITICAL, 1.156673609, 6.158738248, 4.854332428, 0.0),
    "friction": (0.05, 1.05 * CRITICAL, 1.3285288, 22.0252877, 20.0171897, -0.1656698),
}
REFERENCE_DIGITS = 1e-8  # the references have 9 and 10 digits; 2000 steps a period leave less
STEPS = 2000
ORDER = 67  # 22 blades: harmonics -1, 21, -23, 43, -45, 65, -67, of which the last are 1e-7 of the first
SAMPLES = 8448  # the kinks of the contact forces alias as 1/samples**2
# Of the residual that a motion 1 % larger has: harmonics left out, aliasing and the steps of time integration leave 1e-6 of the
# motion.
NEGLIGIBLE = 1e-4


def accelerated(state, friction, speed):
    """Rates of (q1, q2, r1, r2, and their velocities), one column for each motion, in the rotating frame."""
    q, r, dq, dr = state[0:2], state[2:4], state[4:6], state[6:8]
    turn = DIAMETERS * speed
    load = CONTACT * np.maximum(0.0, -(GAP + RADIAL.T @ (r - q)))
    seen = np.array([dr[0] - turn * r[1], dr[1] + turn * r[0]])
    ddq = -RADIAL @ load - friction * ARMS[0] * TANGENTIAL @ load
    ddq -= (2 * ZETA * DISK + CUBIC * np.sum(dq**2, axis=0)) * dq + DISK**2 * q
    ddr = RADIAL @ load + friction * ARMS[1] * TANGENTIAL @ load
    ddr -= (2 * ZETA * CASING + CUBIC * np.sum(seen**2, axis=0)) * seen + CASING**2 * r
    ddr += np.array([2 * turn * dr[1] + turn**2 * r[0], -2 * turn * dr[0] + turn**2 * r[1]])
    return np.concatenate([dq, dr, ddq, ddr])


def integration(state, period, friction, speed):
    """States at STEPS + 1 instants of one period."""
    h = period / STEPS
    states = [state]
    for _ in range(STEPS):
        a = accelerated(state, friction, speed)
        b = accelerated(state + h / 2 * a, friction, speed)
        c = accelerated(state + h / 2 * b, friction, speed)
        d = accelerated(state + h * c, friction, speed)
        state = state + h / 6 * (a + 2 * b + 2 * c + d)
        states.append(state)
    return np.array(states)


def limit_cycle(friction, speed, frequency, disk, casing, phase):
    """States over one period that begins with q2 = 0, the period, and the Floquet multipliers."""
    r = casing * np.exp(1j * phase)
    state = np.array([disk, 0.0, r.real, r.imag, 0.0, -frequency * disk, frequency * r.imag, -frequency * r.real])
    period, h = 2 * np.pi / frequency, 1e-6
    for _ in range(12):
        bundle = np.repeat(state[:, None], 9, axis=1)
        bundle[:, :8] += h * np.eye(8)
        states = integration(bundle, period, friction, speed)
        missed = states[-1] - states[0]
        slopes = np.zeros((9, 9))
        slopes[:8, :8] = (missed[:, :8] - missed[:, 8:]) / h
        slopes[:8, 8] = accelerated(states[-1][:, 8:], friction, speed)[:, 0]
        slopes[8, 1] = 1.0
        error = np.append(missed[:, 8], state[1])
        if np.linalg.norm(error) < 1e-10:
            return states[:-1, :, 8], period, np.linalg.eigvals(slopes[:8, :8] + np.eye(8))
        step = np.linalg.solve(slopes, -error)
        state, period = state + step[:8], period + step[8]
    raise AssertionError("no period that repeats")


@pytest.fixture(scope="module", params=[pytest.param("frictionless", marks=pytest.mark.long), "friction"])
def cycle(request):
    return CYCLES[request.param], limit_cycle(*CYCLES[request.param])


def wave(states, first):
    """Coefficients of exp(i k w t) in x1 + i x2, k = -ORDER..ORDER."""
    spectrum = np.fft.fft(states[:, first] + 1j * states[:, first + 1]) / len(states)
    return {k: spectrum[k] for k in range(-ORDER, ORDER + 1)}


def start_groups(states, turns):
    """Groups &start of the motion, in which the waves of disk and casing become those of the tuples (k, turns)."""
    lines = []
    for first, names in ((0, ("q1", "q2")), (2, ("r1", "r2"))):
        for k, z in wave(states, first).items():
            if abs(z) < 1e-14:
                continue
            tuple_ = f"{k}" if turns is None else f"{k}, {turns}"
            # z exp(i a) is x1 = Re z cos a - Im z sin a, x2 = Im z cos a + Re z sin a
            for name, cosine, sine in ((names[0], z.real, -z.imag), (names[1], z.imag, z.real)):
                lines.append(f"&start dof = '{name}', tuple = {tuple_}, cos = {float(cosine)!r}, sin = {float(sine)!r} /")
    return "\n".join(lines) + "\n"


def model(frame, friction, speed, frequency):
    """Input of the model without the start."""
    moving = frame == "stationary"
    tones = f"{frequency!r}, {speed!r}" if moving else f"{frequency!r}"
    if moving:
        tuples = ["0,0", "0,3"] + [f"{k},{n}" for k in range(1, ORDER + 1) for n in (-3, 3)]
        harmonics = f"set = 'list', tuples = {', '.join(tuples)}"
    else:
        harmonics = f"order = {ORDER}"
    tone = "tone = 2, " if moving else ""
    return f"""
&structure type = 'rotor_stator', frame = '{frame}', n_diameters = {DIAMETERS}, speed = {speed!r}, disk_frequency = {DISK},
   casing_frequency = {CASING}, disk_damping_ratio = {ZETA}, casing_damping_ratio = {ZETA} /
&tones frequency = {tones} /
&harmonics {harmonics} /
&sampling samples = {SAMPLES}{", 8" if moving else ""} /
&law type = 'blade_contact', dofs = 'q1', 'q2', 'r1', 'r2', frame = '{frame}', {tone}n_diameters = {DIAMETERS},
   n_blades = {BLADES}, gaps = {GAP}, stiffness = {CONTACT}, friction_coefficient = {friction},
   friction_arms = {ARMS[0]!r}, {ARMS[1]!r} /
&law type = 'cubic_damping', dofs = 'q1', 'q2', coefficient = {CUBIC}, n_diameters = {DIAMETERS},
   speed = {-speed if moving else 0.0!r} /
&law type = 'cubic_damping', dofs = 'r1', 'r2', coefficient = {CUBIC}, n_diameters = {DIAMETERS},
   speed = {0.0 if moving else speed!r} /
&solver max_iterations = 0, fallback = .false., first_guess = 'zero' /
"""


def test_integration_finds_the_reference(cycle):
    (_, _, frequency, disk, casing, _), (states, period, _) = cycle
    assert 2 * np.pi / period == pytest.approx(frequency, rel=REFERENCE_DIGITS)
    assert np.hypot(states[:, 0], states[:, 1]).mean() == pytest.approx(disk, rel=REFERENCE_DIGITS)
    assert np.hypot(states[:, 2], states[:, 3]).mean() == pytest.approx(casing, rel=REFERENCE_DIGITS)


def test_limit_cycle_is_stable(cycle):
    multipliers = np.sort(np.abs(cycle[1][2]))
    assert multipliers[-1] == pytest.approx(1.0, abs=1e-3), "along the cycle itself"
    assert multipliers[-2] < 0.9


@pytest.mark.long  # seconds of SciPy
def test_small_limit_cycle_is_unstable():
    """The cycle that inputs/rotor_stator/rotating.nml finds from a small wave: disk and casing in opposition."""
    states, period, multipliers = limit_cycle(0.0, 0.909, 1.0138, 0.646, 0.3886, np.pi)
    assert 2 * np.pi / period == pytest.approx(1.01378986, rel=REFERENCE_DIGITS)
    assert np.hypot(states[:, 0], states[:, 1]).mean() == pytest.approx(0.6460444, rel=1e-6)
    assert np.hypot(states[:, 2], states[:, 3]).mean() == pytest.approx(0.3886112, rel=1e-6)
    assert np.max(np.abs(multipliers)) == pytest.approx(1.954, rel=1e-3)


@pytest.mark.parametrize("frame", ["rotating", "stationary"])
def test_integrated_cycle_has_no_residual(cycle, frame, tmp_path):
    (friction, speed, *_), (states, period, _) = cycle
    turns = None if frame == "rotating" else DIAMETERS
    text = model(frame, friction, float(speed), float(2 * np.pi / period))
    residuals = [
        float(read(solve(text + start_groups(stretch * states, turns), tmp_path, status=None), "residual")[0])
        for stretch in (1.0, 1.01)
    ]
    assert residuals[0] < NEGLIGIBLE * residuals[1]
