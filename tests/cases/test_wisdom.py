"""FFTW's wisdom: created once, stored in a file, the same for all ranks and later runs."""

from program import BAD_INPUT, read, run, solve

MODEL = """
&structure type = 'beam', length = 1.0, bending_stiffness = 1750.0, mass_per_length = 7.8, n_elements = 4,
   damping_diagonal = 1.0 /
&tones frequency = 2.718281828459045, 3.141592653589793 /
&harmonics order = 5 /
&sampling samples = 32, planning = 'measure', wisdom = '{wisdom}' /
&load dof = 'v3', tuple = 1, 0, cos = 100.0 /
&load dof = 'v3', tuple = 0, 1, cos = 100.0 /
&law type = 'rigid_wall', dof = 'v3', gap = 1.5e-3 /
&certificate truncation = 1.0, penetration = 1.0 /   ! order 5 for the speed: only the plans are in question
&sweep parameter = 'law(1)%gap', values = 1.2e-3, 1.5e-3, 1.8e-3 /
"""


def test_wisdom_is_written_once_and_read_by_all_ranks_and_runs(tmp_path):
    wisdom = tmp_path / "plans.fftw"
    first = read(solve(MODEL.format(wisdom=wisdom), tmp_path, name="first"), "coefficients")
    kept = wisdom.read_bytes()
    assert kept.startswith(b"(fftw-3")
    later = read(solve(MODEL.format(wisdom=wisdom), tmp_path, ranks=2, name="later"), "coefficients")
    assert wisdom.read_bytes() == kept
    assert first.tobytes() == later.tobytes()


def test_wisdom_that_cannot_be_written_is_bad_input(tmp_path):
    source = tmp_path / "case.nml"
    source.write_text(MODEL.format(wisdom=tmp_path / "no" / "folder" / "plans.fftw"))
    done = run("solve", source, cwd=tmp_path)
    assert done.status == BAD_INPUT
    assert "wisdom: cannot write" in done.stderr
    assert not (tmp_path / "case.h5").exists()
