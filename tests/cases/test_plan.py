"""nhbm plan: size of the result file, time on any number of ranks, messages."""

import h5py
import pytest

from program import run, solve

INPUT = """
&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,
   damping_mass = 0.02 /
&tones frequency = 0.5 /
&harmonics order = 3 /
&load dof = 'x1', tuple = 1, cos = 0.1 /
&law type = 'cubic_spring', dof = 'x1', stiffness = 1.0 /
&solver first_guess = 'linear' /
&sweep parameter = 'tones%frequency', from = 0.5, to = 0.9, n = 20 /
"""


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "case.nml"
    path.write_text(INPUT)
    return path


def plan(source, *options, status=0):
    done = run("plan", source, *options, cwd=source.parent)
    assert done.status == status, done.stderr
    return done


def table_of(source, *options):
    """Rows (ranks, seconds, efficiency) of the output of the verb."""
    first, *rows = [line.split() for line in plan(source, *options).stdout.splitlines()[1:]]
    assert first == ["ranks", "seconds", "efficiency"]
    return [tuple(map(float, row)) for row in rows]


def test_size_is_that_of_the_file(source, tmp_path):
    words = plan(source).stdout.split()
    n_points, n_bytes, n_datasets = int(words[0]), int(words[3]), int(words[6])
    assert words[8:] == [f"{n_points * n_bytes / 1e3:.0f}", "kB"]
    with h5py.File(solve(INPUT, tmp_path), "r") as file:
        rows = [d for d in file.values() if d.shape and d.shape[0] == 20 and d.dims[0].keys() or d.name == "/point"]
        rows = [d for d in rows if d.name == "/point" or file["point"] == d.dims[0][0]]
        assert n_points == 20
        assert n_bytes * 20 == sum(d.size * d.dtype.itemsize for d in rows)
        assert n_datasets == len(rows) - 2, "all but the scale and the swept parameter, which stand there from the start"


def test_the_size_by_tolerance_is_that_of_a_complete_file(source, tmp_path):
    """Not that of the room for all harmonics, which is reserved as a sparse file."""
    text = INPUT.replace("&harmonics order = 3 /", "").replace("n = 20", "n = 400")
    source.write_text(text)
    words = plan(source).stdout
    assert " kB with 8 harmonics a point" in words
    planned = 400 * int(words.split()[3])
    assert 0.5 < planned / solve(text, tmp_path).stat().st_size < 2.0
    reserved, unit = words.partition("the file looks ")[2].split()[:2]
    reserved = float(reserved) * {"MB": 1e6, "GB": 1e9}[unit]
    assert reserved > 50 * planned


def test_equal_points_on_ranks(source):
    """Twenty points of a second: twenty seconds on one rank, ten on two, seven on three."""
    rows = table_of(source, "--cost", "1.0", "--ranks", "1,2,3")
    assert rows == [(1, 20, 1.0), (2, 10, 1.0), (3, 7, 0.9524)]


def test_costs_of_a_result(source, tmp_path):
    result = solve(INPUT, tmp_path)
    with h5py.File(result, "r") as file:
        seconds = file["solve_seconds"][()]
    ((ranks, wall, efficiency),) = table_of(source, "--cost-from", result, "--points", "200", "--ranks", "1")
    assert (ranks, wall) == (1, pytest.approx(10 * seconds.sum() + seconds.max() - seconds.mean(), rel=1e-3))
    assert efficiency == pytest.approx(10 * seconds.sum() / wall, abs=1e-3)


def test_points_fill_whole_lines(source):
    assert plan(source, "--points", "21").stdout.startswith("40 points ")


def test_chains_are_solved_by_one_rank(source):
    """Twenty points in chains of eight are three tasks."""
    chain = ("--set", "solver%first_guess='neighbour'", "--set", "solver%chain_length=8")
    assert table_of(source, "--cost", "1.0", "--ranks", "100", *chain) == [(100, 8, 0.025)]


@pytest.mark.parametrize(
    "options, message",
    [
        (["--ranks", "2,x"], "--ranks needs whole numbers, 1 or more, separated by commas, not '2,x'"),
        (["--ranks", "0"], "--ranks needs whole numbers, 1 or more, separated by commas, not '0'"),
        (["--points", "many"], "--points: 'many' is not a number"),
        (["--cost", "-1.0"], "--cost: '-1.0' is not a number greater than 0"),
        (["--cost-from", "none.h5"], "--cost-from 'none.h5'"),
    ],
)
def test_mistakes_are_reported(source, options, message):
    assert message in plan(source, *options, status=2).stderr
