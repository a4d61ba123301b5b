"""Ctrl-C in the middle of work, by processor time: how busy the machine is plays no part."""

import os

# A process's work is over when it has computed for so long; nothing is measured against it.
HANG_S = 300

INTERRUPTS = """
import os, signal, threading, time

signal.signal(signal.SIGINT, signal.default_int_handler)

def interrupted(work, after_s, wall_s=float("inf")):
    '''Send Ctrl-C to this process after so much work, and say how much more was done until work ended.'''
    sent = []

    def watch(began):
        latest = time.monotonic() + wall_s
        while time.process_time() - began < after_s and time.monotonic() < latest:
            time.sleep(0.002)
        sent.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=watch, args=(time.process_time(),), daemon=True).start()
    try:
        work()
    except KeyboardInterrupt:
        return f"interrupted {time.process_time() - sent[0]}"
    return "finished"
"""


def assert_prompt(line, wall_s):
    """Assert that work ended within as much processor time as all processors have in `wall_s`."""
    word, _, spent_s = line.strip().partition(" ")
    assert word == "interrupted", line
    assert float(spent_s) < wall_s * (os.cpu_count() or 1)
