"""Real-time privileges for the loop's thread; each one that is refused is said once and does without."""

import ctypes
import gc
import os
import sys

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4  # sys/mman.h
LOCKED = MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT
"""What has been used once stays in memory. Without ONFAULT all that is merely reserved would be filled as well: whole
stacks of threads and libraries of which a tenth is used, 530 MB more on a rover."""
SWITCH_INTERVAL_S = 5e-4  # a helper thread holds the interpreter lock no longer than this


def enter_real_time(priority: int) -> tuple[str, ...]:
    """Give the calling thread SCHED_FIFO at `priority` and lock memory; returns one sentence per refusal.

    Priority 0 leaves the scheduler alone. Call it after all helper threads have been started: they keep the
    ordinary scheduler, and threads made later are reset to it.
    """
    refusals = []
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    if priority > 0:
        libc = ctypes.CDLL(None, use_errno=True)
        # before the priority: locking a GB takes longer than LimitRTTIME lets a real-time thread go without a pause
        if libc.mlockall(LOCKED) != 0:
            refusals.append(
                f"memory is not locked ({os.strerror(ctypes.get_errno())}): page faults can delay a tick; "
                "set LimitMEMLOCK=infinity"
            )
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
        except OSError as error:
            refusals.append(
                f"no real-time priority ({error.strerror}): the loop runs at ordinary priority; "
                "run as a service with LimitRTPRIO=60 or as root"
            )
    return tuple(refusals)


def leave_real_time() -> None:
    """Ordinary scheduling again, for the summary and the shutdown."""
    if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO:
        # without privileges the flag cannot be taken back: the kernel refuses (EPERM) whoever clears it
        os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
    ctypes.CDLL(None).munlockall()
    gc.enable()


def freeze_garbage() -> None:
    """Take all objects made so far out of the collector and stop it: a full collection costs 400 ms here.

    What the start has used and given back goes to the system before it is locked.
    """
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    gc.freeze()
    gc.disable()
