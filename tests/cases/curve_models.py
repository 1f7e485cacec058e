"""Models of several tests of curves, and the columns that define the course of a curve."""

from pathlib import Path

from program import read

DUFFING = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 0.05 /
&tones frequency = 0.5 /
&harmonics order = 5 /
&load dof = 'x1', tuple = 1, cos = 0.18 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 0.1 /
"""
SOLUTION = (
    "status", "coefficients", "force_coefficients", "residual", "iterations", "curve_kind", "curve_length",
    "curve_unknowns", "curve_direction", "curve_step", "curve_orientation", "curve_largest_motion", "curve_unreliable_steps",
    "curve_exhausted_steps", "checksum",
)  # fmt: skip
STOP = """
&structure type = 'chain', n_masses = 2, mass = 1.0, coupling_stiffness = 1.0, damping_stiffness = 0.03, ends = 'fixed-free' /
&tones frequency = 0.3 /
&load dof = 'x2', tuple = 1, cos = 0.1 /
&law type = 'elastic_stop', dof = 'x2', stiffness = 100.0, gap = 1.0 /
&accuracy tolerance = 1e-3 /
&curve parameter = 'tones%frequency', from = 0.3, to = 1.2, points = 300 /
"""
UNUSED, PENDING, COLLAPSED = 17, 0, 10
FOLD, BRANCH, DOUBLING, TORUS, GRAZE = 3, 7, 8, 9, 11
INPUTS = Path(__file__).resolve().parents[2] / "inputs"


def assert_same_bits(a, b, moving="tones_frequency"):
    names = [*SOLUTION, moving]
    for name, one, other in zip(names, read(a, *names), read(b, *names)):
        assert one.tobytes() == other.tobytes(), name
