"""Many contacts, each of them local: as many as there are masses, and between neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from program import BAD_INPUT, read, run, solve

TONE = "&tones frequency = 1.1 /\n&harmonics order = 7 /\n&error_estimate is_on = .false. /\n&stability method = 'off' /\n"


def pairs(n: int, law: str, coupling: float = 0.0) -> str:
    """A chain of `n` pairs of masses with a law between the two of each; `coupling` is the spring between two pairs."""
    springs = ", ".join(["0.5", str(coupling)] * (n - 1) + ["0.5"])
    lines = [
        f"&structure type = 'chain', n_masses = {2 * n}, ends = 'free', mass = {2 * n}*1.0, coupling_stiffness = {springs}",
        f"   ground_stiffness = {2 * n}*1.0, damping_mass = 0.1 /",
    ]
    for i in range(1, 2 * n, 2):
        lines.append(f"&load dof = 'x{i}', tuple = 1, cos = 0.4 /")
        lines.append(f"&law dofs = 'x{i}', 'x{i + 1}', weights = 1.0, -1.0, {law} /")
    return "\n".join(lines) + "\n" + TONE


@pytest.mark.parametrize(
    "law", ["type = 'elastic_stop', stiffness = 2.0, gap = 0.3", "type = 'jenkins', stiffness = 1.0, limit = 0.2"]
)
def test_a_thousand_pairs_move_as_one(law, tmp_path):
    """Pairs that nothing couples: each moves as the only pair of a model of two masses."""
    one = read(solve(pairs(1, law), tmp_path, name="one"), "coefficients")[0]
    many = read(solve(pairs(1000, law), tmp_path, name="many"), "coefficients")[0]
    assert np.abs(one[:, 1:]).max() > 1e-3 * np.abs(one).max()  # the law matters
    many = many.reshape(1000, *one.shape)
    np.testing.assert_allclose(many, np.broadcast_to(one, many.shape), atol=1e-6 * np.abs(one).max())


def test_coupled_pairs_follow_the_order_of_the_chain(tmp_path):
    """A chain read from its other end has the same motion, from the other end."""
    law = "type = 'elastic_stop', two_sided = .true., stiffness = 2.0, gap = 0.2"
    text = pairs(300, law, coupling=0.3)
    turned = text
    for i in range(1, 600, 2):
        turned = turned.replace(f"&load dof = 'x{i}',", f"&load dof = 'x{601 - i}' ,")
    c = read(solve(text, tmp_path, name="given"), "coefficients")[0]
    d = read(solve(turned, tmp_path, name="turned"), "coefficients")[0]
    np.testing.assert_allclose(d[::-1], c, atol=1e-6 * np.abs(c).max())


def test_equal_labels_are_found_among_many_laws(tmp_path):
    """A label that is given twice is an error that names both groups, whatever their number."""
    text = pairs(400, "type = 'cubic_spring', stiffness = 0.1")
    lines = text.splitlines()
    laws = [k for k, line in enumerate(lines) if line.startswith("&law")]
    for k in (laws[17], laws[300]):
        lines[k] = lines[k].replace("&law ", "&law label = 'a' ")
    (tmp_path / "case.nml").write_text("\n".join(lines))
    done = run("solve", tmp_path / "case.nml", "--quiet", cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert "&law(301)" in done.stderr and "label of &law(18)" in done.stderr
