"""Ctrl-C inside compiled code: exit code 130, no traceback, and the campaign goes on unharmed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from etude.cli import entrance

HERE = Path(__file__).parent
PRESSES = 3
"""As many as the driver has delays; each is a round of a campaign."""


@pytest.mark.slow
@pytest.mark.parametrize("presses", [PRESSES, 4 * PRESSES])
def test_ctrl_c_in_compiled_code(presses: int, tmp_path: Path) -> None:
    places = os.pathsep.join(part for part in (str(HERE), os.environ.get("PYTHONPATH")) if part)
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": places}
    command = [sys.executable, str(HERE / "interrupt_driver.py"), str(tmp_path), str(presses), "1"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=environment, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    interrupted = int(done.stdout.split("interrupted ")[1].split()[0])
    assert interrupted >= presses // 2, "Ctrl-C came too late to test anything"


SWALLOWED = """
import ctypes, os, signal, sys, time
from etude import cli
from etude.cli import status
def swallow():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.01)
def run(self, say):
    # a callback from C has nobody to pass an exception to: Python prints it, and goes on
    ctypes.CFUNCTYPE(None)(swallow)()
    raise SystemError("went on")
status.Status.run = run
sys.exit(cli.main())
"""


@pytest.mark.parametrize("as_json", [False, True])
def test_ctrl_c_in_a_callback_that_swallows_it(as_json: bool) -> None:
    command = [sys.executable, "-c", SWALLOWED, "status", "lab", *(["--json"] if as_json else [])]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stderr == f"etude: {entrance.KEPT}\n"
    if as_json:
        error = json.loads(done.stdout)["error"]
        assert (error["kind"], error["fact"], error["exit_code"]) == ("Interrupted", entrance.KEPT, 130)
    else:
        assert done.stdout == ""


PENDING = """
import ctypes, signal
from numba import cfunc, types
from etude.cli.entrance import end_on_interrupt

def c(name, *kinds):
    address = ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value
    return ctypes.CFUNCTYPE(*kinds)(address)

raise_signal = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int)(("raise", ctypes.CDLL(None)))
set_error = c("PyErr_SetNone", None, ctypes.c_size_t)
check = c("PyErr_CheckSignals", ctypes.c_int)
number, error = int(signal.SIGINT), id(ValueError)

@cfunc(types.void())
def with_an_error_pending():
    raise_signal(number)
    set_error(error)
    check()

end_on_interrupt("Over.")
ctypes.PYFUNCTYPE(None)(with_an_error_pending.address)()
"""


def test_c_code_that_lets_it_in_with_an_error_pending() -> None:
    done = subprocess.run([sys.executable, "-c", PENDING], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "Over.\n")


SILENT = """
import os, signal
from etude.cli.entrance import end_on_interrupt
from etude.logs.readers.frames import without_panics_on_screen
end_on_interrupt("Over.")
with without_panics_on_screen():
    os.kill(os.getpid(), signal.SIGINT)
"""


def test_its_words_are_seen_while_a_file_is_read() -> None:
    done = subprocess.run([sys.executable, "-c", SILENT], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "Over.\n")


WORKERS = """
import os, signal, sys, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from etude.cli.entrance import end_on_interrupt
if __name__ == "__main__":
    end_on_interrupt("Over.")
    pool = ProcessPoolExecutor(1, get_context("spawn"))
    print(pool.submit(os.getpid).result(), flush=True)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(60)
"""


def test_no_worker_outlives_it(tmp_path: Path) -> None:
    script = tmp_path / "workers.py"
    script.write_text(WORKERS)
    done = subprocess.run([sys.executable, str(script)], check=False, capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stderr.startswith("Over.\n")  # multiprocessing may add that it cleaned up its semaphores
    assert "Traceback" not in done.stderr
    worker = int(done.stdout)
    deadline = time.monotonic() + 10.0
    while alive(worker) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not alive(worker)


def alive(process: int) -> bool:
    """Whether a process runs; one that ended and that nobody has collected does not."""
    status = Path(f"/proc/{process}/stat")
    try:
        return status.read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_a_job_in_the_background_stays_deaf() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        entrance.end_on_interrupt("Over.")
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_outside_the_main_thread_nothing_changes() -> None:
    before = signal.getsignal(signal.SIGINT)
    failed: list[BaseException] = []

    def both() -> None:
        try:
            entrance.end_on_interrupt("Over.")
            entrance.ignore_from_now()
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=both)
    thread.start()
    thread.join()
    assert failed == []
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_after_the_end_is_too_late(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys; from etude import cli\n"
        "code = cli.main()\nos.kill(os.getpid(), signal.SIGINT)\nsys.exit(code)"
    )
    command = [sys.executable, "-c", code, "status", str(tmp_path)]
    assert subprocess.run(command, check=False, capture_output=True).returncode == 2


def test_a_program_that_is_ended_says_so_with_143() -> None:
    program = """
import os, signal
from etude.cli.entrance import end_on_interrupt
end_on_interrupt("Over.", lambda code: f"line {code}")
os.kill(os.getpid(), signal.SIGTERM)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (143, "line 143\n", "Over.\n")
