"""The scripts for Slurm on the pages: a job is successful if its run is complete, and is queued again if points are left."""

import os
import re
import subprocess
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
SCRIPTS = {
    f"{page}:{i}": text
    for page in ("user/cluster.md", "howto/cluster.md")
    for i, text in enumerate(re.findall(r"```sh\n(.*?)```", (DOCS / page).read_text(), re.DOTALL))
    if "#SBATCH" in text
}


def ended(script, folder, status, queue=0):
    """Runs a script by `sh` with programs in the place of those of a cluster; `nhbm info` has this status. Returns the
    status of the job and whether it was queued again."""
    programs = {
        "srun": 'exec "$@"',
        "nhbm": f'[ "$1" = info ] && exit {status}; exit 143',
        "scontrol": f'echo "$@" > queued; exit {queue}',
    }
    for name, text in programs.items():
        (folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (folder / name).chmod(0o755)
    (folder / "job").write_text(script)
    names = {"SLURM_ARRAY_TASK_ID": "3", "SLURM_ARRAY_JOB_ID": "17", "SLURM_JOB_ID": "17"}
    environment = {**os.environ, **names, "PATH": f"{folder}:{os.environ['PATH']}"}
    done = subprocess.run(["sh", "job"], cwd=folder, env=environment, capture_output=True, timeout=60)
    return done.returncode, (folder / "queued").exists()


@pytest.mark.parametrize("name", SCRIPTS)
def test_status_of_a_job_is_that_of_its_run(name, tmp_path):
    script = SCRIPTS[name]
    assert script.startswith("#!/bin/sh\n"), "sbatch refuses a script without an interpreter"
    for label, status, queue, is_successful, is_queued in (
        ("complete", 0, 0, True, False),
        ("points are left", 3, 0, True, True),
        ("not queued again", 3, 1, False, True),
        ("no result", 2, 0, False, False),
    ):
        folder = tmp_path / label.replace(" ", "_")
        folder.mkdir()
        code, queued = ended(script, folder, status, queue)
        assert (code == 0) == is_successful and queued == is_queued, label


def test_both_scripts_are_found():
    assert len(SCRIPTS) == 2
