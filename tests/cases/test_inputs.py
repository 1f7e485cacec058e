"""Every example input runs unchanged and gives the numbers of its `! expect:` lines.

Of the random problems every twentieth is solved in the short run as well.
"""

import re

import pytest
from nhbm_post.reader import SOLVED, Results

from expectations import expects_only_converged, failures, has_only_answers, read_expectations
from input_cases import INPUTS, input_case
from program import ALL_CONVERGED, NOT_ALL_CONVERGED, messages_of, run, solve
from user_law import with_its_law

# Those of user_law need libraries that are built first: test_user_law.py runs them. Those of sequence of orders are for another
# verb: test_bench.py runs them, and those of time: test_motions_over_time.py. Those of models need the file that the script
# beside them makes: test_models.py runs them.
FILES = sorted(file for file in INPUTS.rglob("*.nml") if file.parent.name not in ("user_law", "order_sequence", "models", "time"))


CASES = [input_case(file) for file in FILES]


def test_there_are_inputs():
    assert FILES


@pytest.mark.parametrize("source", CASES)
def test_input_gives_what_it_promises(source, tmp_path):
    expectations = read_expectations(source.read_text())
    assert expectations, f"{source} has no '! expect:' line"
    # of hard/random_contact_mass 94 of 200 points took 139 s of the processor
    limit = 1500 if "\n! label: long\n" in source.read_text() else 120
    done = run("solve", with_its_law(source, tmp_path / "law"), cwd=tmp_path, limit=limit)
    result = tmp_path / f"{source.stem}.h5"
    is_answered = expects_only_converged(expectations)
    if not is_answered:  # the last point of a curve may be a regular end without a motion
        with Results(result) as results:
            is_answered = results.curve is not None and has_only_answers(results)
    for switched in tmp_path.glob(f"{source.stem}_*.h5"):  # the motions that leave a curve have files of their own
        with Results(switched) as results:
            is_answered = is_answered and has_only_answers(results)
    assert done.status == (ALL_CONVERGED if is_answered else NOT_ALL_CONVERGED), done.stderr + messages_of(result)
    with Results(result) as results:
        problems = failures(expectations, results)
    assert not problems, "\n".join(problems)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "least"), [("random_contact_beam", 8), ("random_contact_mass", 5)]
)
def test_some_of_the_random_problems(name, least, tmp_path):
    """Among every twentieth of 200 problems the share solved by the balance alone is as large as among all."""

    def some(values):
        return "values =" + ",".join(values.group(1).split(",")[::20]) + "/"

    text = re.sub(r"values =([^/]*)/", some, (INPUTS / "hard" / f"{name}.nml").read_text())
    text += "&solver fallback_by_integration = .false. /\n"
    with Results(solve(text, tmp_path, status=NOT_ALL_CONVERGED)) as results:
        assert results.n_points == 10
        assert sum(status in SOLVED for status in results.status) >= least


# Difficult on purpose: no loads, tones that are close together or nearly static, random tones some of which are.
DOUBTFUL = (
    "at_rest.nml", "at_rest_wall.nml", "close_tones.nml", "pressed_on.nml", "random_contact_beam.nml", "random_contact_mass.nml",
    "relative_wall.nml",
)  # fmt: skip


def checked(file):
    """Those with warnings and the first of each folder; the others are read when they are solved."""
    is_first = file == min(other for other in FILES if other.parent == file.parent)
    return pytest.param(
        file, id=f"{file.parent.name}/{file.name}", marks=[] if is_first or file.name in DOUBTFUL else [pytest.mark.long]
    )


@pytest.mark.parametrize("source", [checked(file) for file in FILES])
def test_input_passes_the_check(source, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    done = run("check", with_its_law(source, tmp_path / "law"), cwd=folder)
    assert done.status == ALL_CONVERGED, done.stderr
    is_doubtful = source.name in DOUBTFUL
    assert ("the input is valid" in done.stdout) != is_doubtful
    assert ("the input can be solved, but see the warnings above" in done.stdout) == is_doubtful
    assert not list(folder.iterdir()), "check must write no file"
