"""Two tones near a resonance and near each other, with little damping: disturbances decay, grow and beat slowly.

The exponent is that of the equations of small disturbances along the motion of the program, integrated for hundreds of decay times.
"""

from __future__ import annotations

import numpy as np

from scene_parts.systems import Law, Motion, System

DECAYS, BEATS = 80.0, 60.0  # of an integration
BLOCK = 4096
SLOW = 0.05  # of the decay without laws: slower exponents are not told apart from zero
MORE = "&accuracy tolerance = 1e-3 /\n"


def draw_system(draw) -> System:
    n = int(draw.integers(1, 3))
    omega = np.cumsum(draw.uniform(0.8, 1.2, n)) if n == 1 else np.array([1.0, draw.uniform(1.5, 3.5)])
    turn = np.linalg.qr(draw.normal(size=(n, n)))[0]
    stiffness = turn @ np.diag(omega**2) @ turn.T
    ratio = 10 ** draw.uniform(-2.7, -1.5)
    damping = turn @ np.diag(2 * ratio * omega) @ turn.T
    middle = omega[0] * (1 + draw.uniform(-3, 12) * ratio)
    apart = middle * ratio * 10 ** draw.uniform(-0.3, 1.0) * np.sqrt(2)
    tones = np.array([middle, middle + apart])
    force = 2 * ratio * omega[0] ** 2  # amplitude 1 in resonance
    first, second, sine = force * draw.uniform(0.3, 1.0), force * draw.uniform(0.1, 0.8), force * draw.uniform(-0.3, 0.3)
    loads = [((1, 0), 0, first, 0.0), ((0, 1), n - 1, second, sine)]
    weights = np.eye(n)[0]
    if draw.random() < 0.7:
        law = Law(weights, "polynomial", square=draw.choice([0.0, draw.uniform(-0.1, 0.1)]), cube=10 ** draw.uniform(-2.0, -0.3))
    else:
        stiffness_of_stop, gap = 10 ** draw.uniform(-1.0, 0.7), draw.uniform(0.1, 0.95)
        law = Law(weights, "stop", stiffness=stiffness_of_stop, gap=gap, is_two_sided=bool(draw.random() < 0.5))
    name = f"{n} dofs, damping {ratio:.1e}, tones {tones[0]:.4f} and {tones[1]:.4f}"
    system = System(np.eye(n), damping, stiffness, tones, loads, [], name)
    system.add_law(law)
    return system


def exponents(system: System, motion: Motion) -> tuple[float, float, float]:
    """Largest exponent [1/s] by the second and by the third third of the integration, and the decay of the linear system."""
    decay = -np.linalg.eigvals(system.state_matrix(np.zeros(1))).real.max()
    beat = 2 * np.pi / abs(system.omega[1] - system.omega[0])
    is_stop = system.laws[0].kind == "stop"
    step = 2 * np.pi / system.omega.max() / (192 if is_stop else 64)
    n_blocks = 3 * int(np.ceil(max(DECAYS / decay, BEATS * beat) / (3 * BLOCK * step)))
    largest = np.abs(motion.amplitudes).max()
    seen = np.abs(motion.amplitudes).max(1) > 1e-6 * largest
    frequencies, amplitudes = motion.frequencies[seen], (motion.amplitudes @ system.weights[0])[seen]
    waves = np.exp(1j * np.outer(step * np.arange(2 * BLOCK + 1) / 2, frequencies))  # of each block but for its phases
    basis, grown = np.eye(2 * system.n), []
    for block in range(n_blocks):
        z = (waves @ (np.exp(1j * frequencies * step * block * BLOCK) * amplitudes)).real
        if is_stop:
            ends = (system.state_matrix(_averages(system.laws[0], z)[:, None]),) * 3
        else:
            matrices = system.state_matrix(system.laws[0].slope(z)[:, None])
            ends = (matrices[:-1:2], matrices[1::2], matrices[2::2])
        basis, triangle = np.linalg.qr(_product(_steps(*ends, step)) @ basis)
        grown.append(np.log(np.abs(np.diag(triangle))))
    thirds = np.reshape(grown, (3, -1, 2 * system.n)).sum(1).max(1) / (BLOCK * step * n_blocks / 3)
    return float(thirds[1]), float(thirds[2]), float(decay)


def _averages(law: Law, z: np.ndarray) -> np.ndarray:
    """Slope of a stop in each step: the share of it that lies beyond the gap. Contacts that begin and end with the steps instead
    would disturb the exponent in the first order."""
    first, last = z[:-1:2], z[2::2]
    moved = np.maximum(np.abs(last - first), np.finfo(float).tiny)
    share = np.clip((np.maximum(first, last) - law.gap) / moved, 0.0, 1.0)
    if law.is_two_sided:
        share = share + np.clip((np.maximum(-first, -last) - law.gap) / moved, 0.0, 1.0)
    return law.stiffness * share


def _steps(first: np.ndarray, middle: np.ndarray, last: np.ndarray, h: float) -> np.ndarray:
    """Matrices of one step of Runge and Kutta each, from those at the ends and in the middle of the steps."""
    one = np.eye(first.shape[-1])
    k1 = first
    k2 = middle @ (one + h / 2 * k1)
    k3 = middle @ (one + h / 2 * k2)
    k4 = last @ (one + h * k3)
    return one + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _product(matrices: np.ndarray) -> np.ndarray:
    """The product of all, the last one on the left; their number is a power of two."""
    while len(matrices) > 1:
        matrices = matrices[1::2] @ matrices[::2]
    return matrices[0]


def truth(system: System, motion: Motion) -> tuple[str, str]:
    """'stable', 'unstable' or 'close', and the numbers behind it."""
    second, third, decay = exponents(system, motion)
    said = f"{second:.2e} {third:.2e} (decay {decay:.1e})"
    spread = abs(third - second) + SLOW * decay
    if max(second, third) < -spread:
        return "stable", said
    return ("unstable" if min(second, third) > spread else "close"), said
