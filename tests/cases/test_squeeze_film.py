"""The circular whirl of a rotor on a squeeze film damper, with the film of the catalogue and with one written in NumPy."""

import numpy as np
import pytest

from in_process import nhbm

MU, R, L, C = 6.76e-3, 39.15e-3, 15e-3, 5e-4  # viscosity, radius, length and clearance of the film


def rotor(speed):
    swap = np.array([[0, 1.0], [-1, 0]])
    model = nhbm.Model(
        nhbm.Matrices(
            mass=np.diag([37.62, 37.62, 0.8, 0.8]),
            damping=np.kron([[530.0, -38.16], [-38.16, 497.3202]], np.eye(2)) + 1.6 * speed * np.kron([[0, 0], [0, 1]], swap),
            stiffness=np.kron([[5.4e6, -388800.0], [-388800.0, 5067036.0]], np.eye(2)),
            labels=["x", "y", "tx", "ty"]),
        tones=[speed])  # fmt: skip
    model.load("x", 1, cos=65.08e-5, frequency_power=2)
    model.load("y", 1, sin=65.08e-5, frequency_power=2)
    return model


def whirl(model):
    """Eccentricity ratio at the film and radius of the disk, from the circular first harmonic."""
    motion = model.solve(order=1)
    x, tilt = (motion.nhbm.harmonic(dof, 1).values for dof in ("x", "tx"))
    return abs(x + 0.894 * tilt) / C, abs(x)


def film(radial, power):
    """Short film, half cavitated, for a circular whirl of the journal: its forces times a power of the eccentricity ratio, the
    radial one times a sign."""

    def force(q, v):
        x, y = (q[:, i] + 0.894 * q[:, 2 + i] for i in (0, 1))
        x_rate, y_rate = (v[:, i] + 0.894 * v[:, 2 + i] for i in (0, 1))
        r = np.sqrt(x**2 + y**2 + 1e-40)
        e = np.where(r.real < 0.95 * C, r / C, 0.95)
        size = MU * R * L**3 / C**2 * (x * y_rate - y * x_rate) / r**3 * e**power
        along, across = radial * 2 * e**2 / (1 - e**2) ** 2, np.pi * e / (2 * (1 - e**2) ** 1.5)
        f = [size * (along * x - across * y), size * (along * y + across * x)]
        return np.stack([*f, 0.894 * f[0], 0.894 * f[1]], axis=1)

    return nhbm.law(force)


@pytest.mark.parametrize("speed", [100.0, 300.0, 370.0, 380.0, 400.0, 600.0])
def test_the_film_of_the_catalogue_is_the_one_of_its_formulas(speed):
    model, other = rotor(speed), rotor(speed)
    model.law("short_bearing", ["x", "tx"], weights=[1, 0.894], second_dofs=["y", "ty"], second_weights=[1, 0.894],
              viscosity=MU, radius=R, length=L, clearance=C)  # fmt: skip
    other.law(film(radial=1, power=0), ["x", "y", "tx", "ty"])
    np.testing.assert_allclose(whirl(other), whirl(model), rtol=1e-9)


@pytest.mark.parametrize("speed, eccentricity, radius", [
    (100.0, 0.0027846711, 1.3030875858e-6), (300.0, 0.0628141272, 2.94172991e-5), (370.0, 0.6483023153, 3.03455111e-4),
    (380.0, 0.8236400202, 3.83861762e-4), (400.0, 0.3252800463, 1.52424080e-4), (600.0, 0.0610199275, 2.86499689e-5),
])  # fmt: skip
def test_radii_of_another_program(speed, eccentricity, radius):
    """The program multiplies the film's force by an additional factor of the eccentricity ratio, and has an outward radial part:
    with both, its radii agree; without them they differ by up to 8 %."""
    model = rotor(speed)
    model.law(film(radial=-1, power=1), ["x", "y", "tx", "ty"])
    assert whirl(model) == (pytest.approx(eccentricity, abs=6e-11), pytest.approx(radius, rel=2e-9))  # the digits given
