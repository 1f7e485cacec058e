"""Bodies that strike several walls and each other, integrated in time: cradles, impact pairs, clamped bodies, in closed form."""

import numpy as np
import pytest
from program import BAD_INPUT, read, run
from scipy.optimize import brentq


def free(masses, walls, more, stiffness=0.0):
    """Masses on springs of their own, with walls given by their degrees of freedom and weights; integrated for 6.5 s."""
    n = len(masses)

    def diagonal(values):
        return ", ".join(str(float(v) if i == k else 0.0) for i, v in enumerate(values) for k in range(n))

    text = f"&structure type='matrices', n_dofs={n}, mass={diagonal(masses)}, stiffness={diagonal([stiffness] * n)} /\n"
    text += "".join(f"&law type='rigid_wall', {wall} /\n" for wall in walls)
    return text + more + "&integration duration=6.5, step=0.1 /\n"


def row_of(n, gap, e):
    """Each mass of a row and its right neighbour."""
    return [f"dofs='x{i}', 'x{i + 1}', weights=1, -1, gap={gap}, restitution={e}" for i in range(1, n)]


def integrated(directory, text, *columns):
    (directory / "model.nml").write_text(text)
    done = run("integrate", "model.nml", "--overwrite", "--quiet", cwd=directory)
    assert done.status == 0, done.stderr
    return read(directory / "model.h5", "time", "displacement", *columns)


@pytest.mark.parametrize("released", [1, 2, 3, 4])
def test_as_many_balls_of_a_cradle_leave_as_arrive(released, tmp_path):
    """Five equal pendulums of period 2 pi that touch at rest: half of each swing is that of as many balls at the other end."""
    start = "".join(f"&initial dof='x{i}', displacement=-0.1 /\n" for i in range(1, released + 1))
    t, x = integrated(tmp_path, free([1.0] * 5, row_of(5, 0.0, 1.0), start, stiffness=1.0))
    swing = -0.1 * np.cos(t)
    for i in range(5):
        expected = np.where(swing < 0, swing if i < released else 0.0, swing if i >= 5 - released else 0.0)
        np.testing.assert_allclose(x[i], expected, atol=1e-7, err_msg=f"ball {i + 1}")


@pytest.mark.parametrize("gap", [0.0, 0.05])
def test_an_impulse_travels_through_unequal_balls(gap, tmp_path):
    """Two impacts, one after the other, whether the balls touch or not; none follows, since the speeds ascend."""
    m, e = [3.0, 2.0, 1.0], 0.7
    text = free(m, row_of(3, gap, e), "&initial dof='x1', displacement=-0.5, velocity=1 /\n")
    t, _, v = integrated(tmp_path, text, "velocity")
    second = m[0] * (1 + e) / (m[0] + m[1])
    first = (m[0] - e * m[1]) / (m[0] + m[1])
    third = m[1] * (1 + e) / (m[1] + m[2]) * second
    second *= (m[1] - e * m[2]) / (m[1] + m[2])
    assert first < second < third
    np.testing.assert_allclose(v[:, t > 0.7], np.array([[first], [second], [third]]) + 0 * t[t > 0.7], rtol=1e-9)


def test_balls_without_restitution_go_on_together(tmp_path):
    text = free([1.0, 2.0, 3.0], row_of(3, 0.0, 0.0), "&initial dof='x1', displacement=-0.5, velocity=6 /\n")
    t, _, v = integrated(tmp_path, text, "velocity")
    np.testing.assert_allclose(v[:, t > 0.1], 1.0, rtol=1e-6)


def test_elastic_impacts_retain_the_energy(tmp_path):
    """Four unequal balls between two walls, some dozens of impacts."""
    m = [1.0, 2.5, 0.7, 1.6]
    walls = [*row_of(4, 0.1, 1.0), "dofs='x1', weights=-1, gap=0.2, restitution=1", "dof='x4', gap=0.15, restitution=1"]
    start = "&initial dof='x2', velocity=3 /\n&initial dof='x3', velocity=-1 /\n"
    _, x, v = integrated(tmp_path, free(m, walls, start), "velocity")
    np.testing.assert_allclose(m @ v**2, 2.5 * 9 + 0.7, rtol=1e-9)
    assert np.max(x[:-1] - x[1:]) <= 0.1 + 1e-9 and x[0].min() >= -0.2 - 1e-9 and x[-1].max() <= 0.15 + 1e-9
    assert np.sum(np.abs(np.diff(np.sign(v), axis=1)) > 0) > 20


@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_an_impact_pair_has_its_periodic_motion(shift, tmp_path):
    """A free mass under a harmonic load between two walls, two equal and opposite impacts in each period (Masri and Caughey 1966).

    Between z = -d, where it leaves with the velocity u, and z = d half a period later z'' = g cos(w t + a):
    sin(a) = -w u (1 - e)/(2 g e) from the velocities and 2 d = u (1 + e)/(2 e) pi/w + 2 g/w^2 cos(a) from the displacements; it is
    stable for cos(a) < 0."""
    d, e, g, w = 0.5, 0.6, 1.0, 2.0

    def misses(u):
        sine = -w * u * (1 - e) / (2 * g * e)
        return u * (1 + e) / (2 * e) * np.pi / w - 2 * g / w**2 * np.sqrt(1 - sine**2) - 2 * d

    u = brentq(misses, 1e-6, 2 * g * e / (w * (1 - e)) * (1 - 1e-12))
    a = np.pi - np.arcsin(-w * u * (1 - e) / (2 * g * e))
    walls = [f"dof='x1', gap={d + shift}, restitution={e}", f"dofs='x1', weights=-1, gap={d - shift}, restitution={e}"]
    load = f"&load dof='x1', frequency={w}, cos={float(g * np.cos(a))!r}, sin={float(-g * np.sin(a))!r} /\n"
    load += f"&initial dof='x1', displacement={shift - d}, velocity={float(u)!r} /\n"
    text = free([1.0], walls, load).replace("duration=6.5, step=0.1", f"duration={20 * np.pi}, step={np.pi / 100}")
    t, x = integrated(tmp_path, text)
    s = np.mod(t, np.pi / w)
    flown = -d + (u - g / w * np.sin(a)) * s - g / w**2 * (np.cos(w * s + a) - np.cos(a))
    smooth = (s > 1e-6) & (s < np.pi / w - 1e-6)
    side = np.where(np.floor(t * w / np.pi) % 2 == 0, 1, -1)
    np.testing.assert_allclose(x[0, smooth] - shift, (side * flown)[smooth], atol=1e-8)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("&integration method='central_differences' /\n", "of the methods of time integration only cvode treats one impact"),
        ("&law type='coulomb_rigid', dof='x1', limit=1 /\n", "are both rigid and share a degree of freedom; use an elastic law"),
    ],
)
def test_what_bodies_between_walls_cannot_have(more, says, tmp_path):
    text = free([1.0, 1.0], row_of(2, 0.1, 1.0) + ["dof='x2', gap=1.0"], "")
    if "&integration" in more:
        text = text.replace("step=0.1", "step=0.1, method='central_differences'")
    else:
        text += more
    (tmp_path / "model.nml").write_text(text)
    done = run("integrate", "model.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and says in done.stderr, done.stderr


def test_a_body_clamped_between_walls_stays(tmp_path):
    """The load presses it against one wall, then against the other."""
    load = "&load dof='x1', cos=2, frequency=3 /\n"
    walls = ["dof='x1', gap=0.0, label='right'", "dofs='x1', weights=-1, gap=0.0, label='left'"]
    t, x, f = integrated(tmp_path, free([1.0], walls, load), "force")
    np.testing.assert_allclose(x, 0.0, atol=1e-12)
    np.testing.assert_allclose(f[0] - f[1], 2 * np.cos(3 * t), atol=1e-9)
    assert f.min() > -1e-9


def test_a_balance_has_no_body_between_walls(tmp_path):
    text = free([1.0, 1.0], row_of(2, 0.1, 1.0) + ["dof='x2', gap=1.0"], "&tones frequency=1 /\n")
    (tmp_path / "model.nml").write_text(text)
    done = run("solve", "model.nml", cwd=tmp_path)
    assert done.status == BAD_INPUT and "model.nml:3: &law(2): type: laws" in done.stderr, done.stderr
    assert "which only time integration supports" in done.stderr
    done = run("check", "model.nml", cwd=tmp_path)
    assert "valid for nhbm integrate alone: laws" in done.stdout, done.stdout
