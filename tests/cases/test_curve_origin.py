"""Origins of curves in files that are no sound results: a message and the exit status of bad input, in every verb that reads
them."""

import os

import pytest

from program import ALL_CONVERGED, BAD_INPUT, run

MODEL = """\
&structure type = 'chain', n_masses = 1, mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 0.9 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 0.1 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&curve parameter = 'tones%frequency', from = 0.5, to = 1.0{origin} /
"""


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sound")
    (folder / "case.nml").write_text(MODEL.format(origin=""))
    assert run("solve", "case.nml", "--quiet", cwd=folder).status == ALL_CONVERGED
    return (folder / "case.h5").read_bytes()


@pytest.mark.parametrize("share", ["text", 0.0, 0.001, 0.02, 0.3, 0.7, 0.99])
def test_an_origin_in_a_damaged_file_is_refused(share, sound, tmp_path):
    damaged = b"no result" if share == "text" else sound[: int(share * len(sound))]
    (tmp_path / "damaged.h5").write_bytes(damaged)
    (tmp_path / "case.nml").write_text(MODEL.format(origin=", origin = 'damaged.h5', origin_point = 0"))
    for words in (["check", "case.nml"], ["solve", "case.nml"], ["resume", "damaged.h5"], ["info", "damaged.h5"],
                  ["why", "damaged.h5"], ["verify", "damaged.h5"]):  # fmt: skip
        done = run(*words, cwd=tmp_path)
        assert done.status == BAD_INPUT, (words, done.status, done.stderr)
        assert "damaged.h5" in done.stderr, (words, done.stderr)
    assert not os.path.exists(tmp_path / "case.h5")
