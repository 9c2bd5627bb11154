"""Training killed with SIGKILL goes on where it was."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tiny import CURRICULUM, train

from re3.training.records import LOG, read_iterations, read_log

PROGRAM = Path(__file__).parent / "tiny.py"


def start(folder):
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.Popen([sys.executable, str(PROGRAM), str(folder)], env=environment)


def kill_after(process, log, iterations, seconds):
    """Kill a process once its log has so many iterations, and so many seconds have passed."""
    deadline = time.monotonic() + 200
    while not log.exists() or len(read_log(log)) < iterations:
        assert process.poll() is None, "ended before it was killed"
        assert time.monotonic() < deadline, f"no {iterations} iterations in time"
        time.sleep(0.005)
    time.sleep(seconds)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_run_killed_again_and_again_has_the_loss_curve_of_an_uninterrupted_one(tmp_path):
    train(tmp_path / "whole")
    folder = tmp_path / "killed"
    # At once, the log is ahead of the checkpoint; later, in the midst of another iteration.
    for iterations, seconds in ((2, 0.0), (4, 0.03), (7, 0.0)):
        kill_after(start(folder), folder / LOG, iterations, seconds)
    assert start(folder).wait(timeout=200) == 0
    killed, whole = (read_iterations(path / LOG) for path in (folder, tmp_path / "whole"))
    assert [entry["iteration"] for entry in killed] == list(range(1, CURRICULUM.iterations + 1))
    for name in ("loss", "gradient_norm", "overlap", "learning_rate", "unroll"):
        np.testing.assert_allclose(
            [entry[name] for entry in killed],
            [entry[name] for entry in whole],
            rtol=1e-6,
            err_msg=name,
        )
