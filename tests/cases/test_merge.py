"""Parts of a sweep, solved by jobs of an array, become the file that one run would have made; what does not fit is refused."""

import shlex

import h5py
import numpy as np
import pytest

from program import BAD_INPUT, INCOMPLETE, NOT_ALL_CONVERGED, run

OSCILLATOR = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 0.05 /
&tones frequency = 0.5 /
&load dof = 'x1', tuple = 1, cos = 0.2 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0, label = 'spring' /
"""
GRID = (
    OSCILLATOR
    + """
&sweep parameter = 'law(spring)%stiffness', from = 0.2, to = 1.7, n = 5 /
&sweep parameter = 'tones%frequency', from = 0.5, to = 2.4, n = 8 /
"""
)
SAMPLES = (
    OSCILLATOR
    + """
&sweep parameter = 'law(spring)%stiffness', from = 0.2, to = 2.2, n = 7, spacing = 'log', axis = 1 /
&sweep parameter = 'tones%frequency', values = 0.5, 0.9, 0.7, 1.4, 1.1, 2.0, 1.7, axis = 1 /
&sweep parameter = 'solver%method', texts = 'newton', 'broyden' /
"""
)
CURVES = (
    OSCILLATOR
    + """
&harmonics order = 5 /
&sweep parameter = 'load(1)%cos', values = 0.1, 0.2, 0.3 /
&curve parameter = 'tones%frequency', from = 0.5, to = 1.6, points = 60, peak_of = 'x1 (1)' /
"""
)
# columns that differ from run to run, or, as the checksums of rows, with the room for harmonics
OTHER = {"rank", "checksum", "input_text", "input_overrides", "input_complete"}


def rows(path):
    with h5py.File(path) as file:
        n = file["point"].shape[0]
        return {
            name: entry[()]
            for name, entry in file.items()
            if entry.ndim and entry.shape[0] == n and name not in OTHER and "seconds" not in name and not name.startswith("worker")
        }


def solve_parts(text, folder, n_parts, group=1, ranks=None, only=None):
    (folder / "case.nml").write_text(text)
    for k in only or range(1, n_parts + 1):
        done = run("solve", "case.nml", "--set", f"sweep({group})%part={k},{n_parts}", "-o", f"case_{k}.h5", "--quiet", ranks=ranks,
                   cwd=folder)  # fmt: skip
        assert done.status in (0, NOT_ALL_CONVERGED), done.stderr
    return [f"case_{k}.h5" for k in only or range(1, n_parts + 1)]


@pytest.mark.parametrize(
    "text, group, n_parts",
    [
        (GRID, 1, 3),
        pytest.param(GRID, 2, 2, marks=pytest.mark.long),
        pytest.param(SAMPLES, 2, 4, marks=pytest.mark.long),
        (CURVES, 1, 2),
    ],
)
def test_merged_parts_are_the_whole(text, group, n_parts, tmp_path):
    """Values, motions and branch numbers are those of one run, also where parts cut the lines along which branches are numbered;
    rows are intact, and the input is that of the whole sweep."""
    parts = solve_parts(text, tmp_path, n_parts, group, ranks=2)
    whole = run("solve", "case.nml", "-o", "whole.h5", "--quiet", cwd=tmp_path)
    done = run("merge", "merged.h5", *parts, cwd=tmp_path)
    assert whole.status == done.status == 0 and f"from {n_parts} files, complete" in done.stdout, done.stderr
    expected, found = rows(tmp_path / "whole.h5"), rows(tmp_path / "merged.h5")
    assert set(expected) == set(found)
    starts_anew = group == 2 and text is GRID  # chains begin at the first point of a part
    for name in ["law_spring_stiffness", "tones_frequency", "load_1_cos", "solver_method", "branch", "status"]:
        if name in expected and not (starts_anew and name == "branch"):
            np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
    for name, values in expected.items():
        if values.dtype.kind == "f" and name in ("coefficients", "frequency", "multiplier_real") and not starts_anew:
            shared = tuple(slice(min(a, b)) for a, b in zip(values.shape, found[name].shape))
            np.testing.assert_array_equal(found[name][shared], values[shared], err_msg=name)
    assert run("info", "merged.h5", "--check", cwd=tmp_path).status == 0
    with h5py.File(tmp_path / "merged.h5") as merged, h5py.File(tmp_path / "whole.h5") as one:
        assert merged["input_complete"][()] == one["input_complete"][()] and merged["input_overrides"][()] == b""
        counts = np.bincount(merged["rank"][:], minlength=2 * n_parts)
        if text is not CURVES:  # whose unused rows have no rank
            np.testing.assert_array_equal(counts, merged["worker_points"][:])
    again = run("resume", "merged.h5", cwd=tmp_path)
    assert again.status == 0, again.stderr


def test_a_missing_part_is_pending(tmp_path):
    """The rest is solved by resume, or by merging again with the missing part."""
    parts = solve_parts(GRID, tmp_path, 3, only=(1, 3))
    done = run("merge", "merged.h5", *parts, cwd=tmp_path)
    assert done.status == INCOMPLETE and "left: nhbm resume merged.h5" in done.stdout
    assert "16 left" in done.stdout, done.stdout
    assert run("resume", "merged.h5", "--quiet", cwd=tmp_path).status == 0
    solve_parts(GRID, tmp_path, 3, only=(2,))
    assert run("merge", "other.h5", "case_3.h5", "case_1.h5", "case_2.h5", cwd=tmp_path).status == 0
    found, expected = rows(tmp_path / "merged.h5"), rows(tmp_path / "other.h5")
    np.testing.assert_array_equal(found["branch"], expected["branch"])
    np.testing.assert_array_equal(found["tones_frequency"], expected["tones_frequency"])


def test_an_interrupted_part_is_complemented(tmp_path):
    """A file may have a part of the points of another one: those that it lacks are taken from there."""
    (tmp_path / "case.nml").write_text(GRID)
    cut = run("solve", "case.nml", "--time-limit", "0", "-o", "cut.h5", "--quiet", cwd=tmp_path)
    assert cut.status == INCOMPLETE
    parts = solve_parts(GRID, tmp_path, 2)
    done = run("merge", "merged.h5", "cut.h5", *parts, cwd=tmp_path)
    assert done.status == 0 and "40 points from 3 files, complete" in done.stdout, done.stderr


def refusal(folder, *words):
    done = run("merge", *words, cwd=folder)
    assert done.status == BAD_INPUT and not (folder / "merged.h5").exists(), done.stdout
    return done.stderr


def test_what_does_not_fit_is_refused(tmp_path):
    one, two = solve_parts(GRID, tmp_path, 2)
    assert "'case_1.h5': its point 0, law(spring)%stiffness = 0.2, tones%frequency = 0.5, is also in 'case_1.h5'" in (
        refusal(tmp_path, "merged.h5", one, one)
    )
    (tmp_path / "other").mkdir()
    (other,) = solve_parts(GRID.replace("cos = 0.2", "cos = 0.3"), tmp_path / "other", 2, only=(2,))
    text = refusal(tmp_path, "merged.h5", one, f"other/{other}")
    assert "'other/case_2.h5': it has another input" in text and "&load: cos: 0.2" in text and "0.3" in text
    assert "part" not in text.partition("alone")[2]
    with h5py.File(tmp_path / two, "r+") as file:
        file["coefficients"][3] += 1.0
    assert "case_2.h5" in refusal(tmp_path, "merged.h5", one, two)
    assert "does not exist" in refusal(tmp_path, "merged.h5", one, "nothing.h5")
    assert "merge needs a new file and those of the parts" in refusal(tmp_path, "merged.h5")
    assert "is the new file and a part" in refusal(tmp_path, one, one)
    sweep_of_orders = OSCILLATOR + "&harmonics order = 1 /\n&sweep parameter = 'harmonics%order', values = 1, 3 /\n"
    (tmp_path / "orders").mkdir()
    files = solve_parts(sweep_of_orders, tmp_path / "orders", 2)
    assert "other harmonics than the whole sweep" in refusal(tmp_path / "orders", "merged.h5", *files)
    assert run("resume", two, "--quiet", cwd=tmp_path).status == 0
    before = (tmp_path / one).read_bytes()
    assert "exists; give --overwrite" in run("merge", one, two, cwd=tmp_path).stderr and (tmp_path / one).read_bytes() == before


@pytest.mark.parametrize("part, message", [
    ("3,2", "must be K, N with 1 <= K <= N, not 3, 2"), ("0,2", "must be K, N with 1 <= K <= N"),
    ("1", "needs two numbers, K, N"), ("1,6", "there are only 5 values for 6 parts"),
])  # fmt: skip
def test_impossible_parts_are_refused(part, message, tmp_path):
    (tmp_path / "case.nml").write_text(GRID)
    done = run("solve", "case.nml", "--set", f"sweep(1)%part={part}", cwd=tmp_path)
    assert done.status == BAD_INPUT and message in done.stderr, done.stderr


def test_plan_prints_the_jobs_of_an_array(tmp_path):
    """Its commands are executed as they are printed."""
    (tmp_path / "case.nml").write_text(GRID)
    told = run("plan", "case.nml", "--set", "law(spring)%stiffness=0.5", "--array", "4", cwd=tmp_path)
    assert told.status == BAD_INPUT  # a swept value
    told = run("plan", "case.nml", "--set", "load(1)%cos=0.1", "--array", "4", "--cost", "2", cwd=tmp_path)
    assert told.status == 0, told.stderr
    solve, merge = [shlex.split(line)[1:] for line in told.stdout.splitlines() if line.startswith("   nhbm")]
    assert "4 jobs, K = 1 to 4, each with a part of the values of law(spring)%stiffness:" in told.stdout
    assert "A job takes 2.0E+01 s on one rank" in told.stdout
    for k in range(1, 5):
        words = [word.replace("part=K", f"part={k}").replace("_K.", f"_{k}.") for word in solve]
        assert run(*words, cwd=tmp_path).status == 0
    assert merge[:2] == ["merge", "case.h5"] and merge[2] == "case_*.h5"
    assert run("merge", "case.h5", *sorted(path.name for path in tmp_path.glob("case_*.h5")), cwd=tmp_path).status == 0
    told = run("plan", "case.nml", "--array", "9", cwd=tmp_path)
    assert told.status == BAD_INPUT and "at most 8 jobs can share the sweep" in told.stderr
    (tmp_path / "one.nml").write_text(OSCILLATOR)
    assert "no &sweep that jobs could share" in run("plan", "one.nml", "--array", "2", cwd=tmp_path).stderr
    assert "part of the values of tones%frequency" in run("plan", "case.nml", "--array", "7", cwd=tmp_path).stdout
