"""Model files under faults: a write that fails, a signal, hostile inputs and names lose nothing and end with a message."""

import errno
import os
import random
import shutil
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from nhbm.command import main
from nhbm.child_process import printable
from nhbm.structure import Structure

ROTOR = ["rotor", "--n-elements", "2", "--bearing", "0.0,1e7,10", "--bearing", "0.6,1e7,10"]

# A child for each call that may fail, until none is left: the imports are made once.
ATTEMPTS = """
import ctypes, os, sys
from nhbm.command import main
from nhbm.child_process import run_in_child_process
library, path, number, step, *words = sys.argv[1:]
arm = ctypes.CDLL(library).fault_arm
calls = 1
while True:
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        arm(calls, int(number), os.fsencode(os.path.dirname(path)))
        os._exit(run_in_child_process(lambda: main([*words, "-o", path, "--overwrite"]), "nhbm-model"))
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    print("attempt", calls, status, sorted(os.listdir(os.path.dirname(path))), hash(open(path, "rb").read()))
    if status == 0:
        break
    calls += int(step)
"""


@pytest.fixture(scope="module")
def faults(tmp_path_factory):
    if shutil.which("cc") is None or sys.platform != "linux":
        pytest.skip("the faults are written in C for Linux")
    library = tmp_path_factory.mktemp("faults") / "faults.so"
    words = ["cc", "-shared", "-fPIC", "-o", library, Path(__file__).parent / "faults.c", "-ldl"]
    subprocess.run(words, check=True)
    return library


def environment(library, **more):
    return {**os.environ, "LD_PRELOAD": str(library), "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONHASHSEED": "1", **more}


@pytest.mark.parametrize("number", [errno.EIO, errno.ENOSPC], ids=["EIO", "ENOSPC"])
def test_a_failed_write_leaves_the_existing_file(number, faults, tmp_path):
    path = tmp_path / "rotor.h5"
    assert main([*ROTOR, "-o", str(path)]) == 0
    words = [sys.executable, "-c", ATTEMPTS, str(faults), str(path), str(number), "1", *ROTOR, "--diameter", "0.03"]
    done = subprocess.run(words, env=environment(faults), capture_output=True, text=True, timeout=600)
    attempts = [line.split(maxsplit=3) for line in done.stdout.splitlines() if line.startswith("attempt")]
    assert len(attempts) > 4 and attempts[-1][2] == "0", done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    old = attempts[0][3]
    for _, calls, status, rest in attempts[:-1]:
        assert status == "2" and rest.startswith("['rotor.h5']"), (calls, status, rest, done.stderr)
    is_unchanged = [rest == old for _, _, _, rest in attempts]
    assert all(is_unchanged[:-2]) and not is_unchanged[-1], attempts  # the last but one may fail after the file was renamed
    assert Structure.read(path).n_dofs > 0


def test_sigterm_ends_both_processes_and_leaves_no_part(faults, tmp_path):
    path = tmp_path / "rotor.h5"
    words = [sys.executable, "-m", "nhbm.command", *ROTOR, "-o", str(path)]
    process = subprocess.Popen(words, env=environment(faults, FAULT_CALLS="2", FAULT_FOLDER=str(tmp_path)))
    for _ in range(600):
        if os.listdir(tmp_path):
            break
        time.sleep(0.05)
    (child,) = map(int, Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split())
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=600) in (128 + signal.SIGTERM, -signal.SIGTERM)
    assert not os.path.exists(f"/proc/{child}") or "Z" in Path(f"/proc/{child}/stat").read_text().split()[2]
    assert not os.listdir(tmp_path)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone ends a process with its parent")
def test_sigkill_leaves_no_child(faults, tmp_path):
    words = [sys.executable, "-m", "nhbm.command", *ROTOR, "-o", str(tmp_path / "rotor.h5")]
    process = subprocess.Popen(words, env=environment(faults, FAULT_CALLS="2", FAULT_FOLDER=str(tmp_path)))
    for _ in range(600):
        if os.listdir(tmp_path):
            break
        time.sleep(0.05)
    (child,) = map(int, Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split())
    process.kill()
    process.wait(timeout=600)
    for _ in range(2000):
        if not os.path.exists(f"/proc/{child}") or "Z" in Path(f"/proc/{child}/stat").read_text().split()[2]:
            break
        time.sleep(0.05)
    else:
        pytest.fail("the child process goes on")


@pytest.mark.parametrize("words", [
    ["import", "--mass", "m.npz", "--stiffness", "k.npz", "-o", "m.npz"],
    ["import", "--mass", "m.npz", "--stiffness", "k.npz", "--labels", "labels", "-o", "link"],
    ["import", "--calculix", "job.inp", "-o", "job.dof"],
    ["reduce", "old.h5", "--keep", "n1.x", "-o", "./old.h5"],
    ["assemble", "a=old.h5", "b=other.h5", "-o", "old.h5"],
])  # fmt: skip
def test_an_input_is_never_replaced(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("m", "k"):
        sp.save_npz(f"{name}.npz", sp.csr_matrix(np.eye(2)))
    Path("labels").write_text("a\nb\n")
    Path("link").symlink_to("labels")
    for end, text in ((".dof", "1.1\n"), (".sti", "1 1 1.0\n"), (".mas", "1 1 1.0\n")):
        Path(f"job{end}").write_text(text)
    for name in ("old.h5", "other.h5"):
        assert main([*ROTOR, "-o", name]) == 0
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    capsys.readouterr()
    assert main([*words, "--overwrite"]) == 2
    assert f"file '{Path(words[-1])}' is an input of this command" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_links_modes_and_what_is_no_file(tmp_path):
    path, link = tmp_path / "rotor.h5", tmp_path / "link.h5"
    before = os.umask(0o027)
    try:
        assert main([*ROTOR, "-o", str(path)]) == 0
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    path.chmod(0o604)
    link.symlink_to(path.name)
    assert main([*ROTOR, "-o", str(link), "--overwrite"]) == 0
    assert link.is_symlink() and stat.S_IMODE(path.stat().st_mode) == 0o604
    os.mkfifo(tmp_path / "pipe.h5")
    assert main([*ROTOR, "-o", str(tmp_path / "pipe.h5"), "--overwrite"]) == 2
    own = tmp_path / "rotor.h5.part"
    own.write_text("mine")
    assert main([*ROTOR, "-o", str(path), "--overwrite"]) == 0
    assert own.read_text() == "mine"


def test_damaged_matrices_and_meshes_give_one_line(tmp_path, capsys):
    """Bytes changed, pieces cut, doubled or put elsewhere; names that are no numbers. None ends in a trace, none writes a model."""
    k = sp.csr_matrix(np.array([[2.0, -1.0], [-1.0, 2.0]]))
    for name, matrix in (("k", k), ("m", sp.identity(2).tocsr())):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", matrix)
        sp.save_npz(tmp_path / f"{name}.npz", matrix)
    (tmp_path / "a.dof").write_text("1.3\n2.3\n")
    (tmp_path / "a.sti").write_text("1 1 2.0\n1 2 -1.0\n2 2 2.0\n")
    (tmp_path / "a.mas").write_text("1 1 1.0\n2 2 1.0\n")
    (tmp_path / "a.inp").write_text("*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n*ELEMENT, TYPE=B31\n1, 1, 2\n*NSET, NSET=TIP\n2\n")
    dice, output = random.Random(7), str(tmp_path / "out.h5")
    at = [str(tmp_path / name) for name in ("m.mtx", "k.mtx", "m.npz", "k.npz", "a", "a.inp")]
    ways = [["--mass", at[0], "--stiffness", at[1]], ["--mass", at[2], "--stiffness", at[3]],
            ["--calculix", at[4], "--mesh", at[5]]]  # fmt: skip
    files = [["k.mtx"], ["k.npz"], ["a.sti", "a.dof", "a.inp"]]
    for _ in range(150):
        i = dice.randrange(len(ways))
        path = tmp_path / dice.choice(files[i])
        whole = path.read_bytes()
        body, at = bytearray(whole), dice.randrange(len(whole))
        accident = dice.randrange(4)
        if accident == 0:
            body[at] = dice.randrange(256)
        elif accident == 1:
            del body[at:]
        elif accident == 2:
            body[at:at] = whole[dice.randrange(len(whole)) :]
        else:
            body[at : at + 3] = dice.choice([b"nan", b"1e999", b"-1", b"99999999999", b"\0\0", b"*NODE\nx"])
        path.write_bytes(body)
        assert main(["import", *ways[i], "-o", output, "--overwrite"]) in (0, 2), bytes(body)
        path.write_bytes(whole)
    printed = capsys.readouterr()
    assert "Traceback" not in printed.err


def test_hostile_words_do_not_command_the_terminal(tmp_path):
    for words in (["check", "no\x1b[2J.h5"], ["\x1b]0;x\x07"], ["info", os.fsdecode(b"no\x9b.h5")],
                  [*ROTOR, "--load", "\x1b[31m=y:1", "-o", "x.h5"]):  # fmt: skip
        done = subprocess.run([sys.executable, "-m", "nhbm.command", *words], cwd=tmp_path, capture_output=True,
                              env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})  # fmt: skip
        assert done.returncode == 2 and done.stderr and not set(done.stderr) & {7, 27, 0x9B}, (words, done.stderr)
        assert b"Traceback" not in done.stderr, done.stderr


def test_printable():
    assert printable("a é ω\nb") == "a é ω\nb"
    assert printable("\x1b[2J\x9b\t\u202e\udc9b") == "\\x1b[2J\\x9b\\x09\\u202e\\x9b"
