"""Work beside the commands: the latest job alone, and none cut off by the end of the process."""

from __future__ import annotations

import subprocess
import sys
import threading

from sfkit_widgets._latest import Latest

ENDING = """
import time
from sfkit_widgets._latest import Latest
begun, waiting = Latest(), Latest(pause=60)
begun.submit(lambda: (time.sleep(0.5), print("ended", flush=True)))
while begun._job is not None:
    time.sleep(0.01)
waiting.submit(lambda: print("never", flush=True))
"""


def test_of_jobs_in_a_row_the_running_and_the_latest_are_done() -> None:
    latest, gate, done = Latest(), threading.Event(), list[int]()
    begun = threading.Event()
    latest.submit(lambda: (begun.set(), gate.wait(300), done.append(0))[0])
    assert begun.wait(300)
    for number in (1, 2, 3):
        latest.submit(lambda number=number: done.append(number))
    gate.set()
    latest.join()
    assert done == [0, 3]


def test_a_job_that_is_cancelled_never_begins() -> None:
    latest, done = Latest(pause=60), list[int]()
    latest.submit(lambda: done.append(1))
    latest.cancel()
    latest.join()
    assert done == []


def test_the_process_ends_after_the_job_under_way() -> None:
    ended = subprocess.run([sys.executable, "-c", ENDING], capture_output=True, text=True, check=True)
    assert (ended.stdout, ended.stderr) == ("ended\n", "")
