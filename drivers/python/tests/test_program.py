"""The start of the commands nhbm-model and nhbm-post."""

import signal
import subprocess
import sys

SLOW = """
import os, signal
os.kill(os.getpid(), signal.SIGINT)  # Ctrl-C during the import

def main_in_child_process():
    return 0
"""
QUICK = "import os, signal\n\ndef main_in_child_process():\n    os.kill(os.getpid(), signal.SIGINT)\n"


def started(folder, text):
    (folder / "a_command.py").write_text(text)
    script = f"import sys; sys.path.insert(0, {str(folder)!r}); from nhbm.program import command_of; command_of('a_command')()"
    # a test that runs in the background of a shell would hand on that interrupts are ignored
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False,
                          preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))


def test_an_interrupt_during_imports_leaves_no_traceback(tmp_path):
    done = started(tmp_path, SLOW)
    assert (done.returncode, done.stderr) == (-signal.SIGINT, "")


def test_an_interrupt_later_reaches_the_command(tmp_path):
    done = started(tmp_path, QUICK)
    assert "KeyboardInterrupt" in done.stderr
