"""What runs in the guest beside the service: installs it as an engineer would, then does to it what a field does.

Every scenario reports what systemd and the service made of it; the judgement is the host's.
"""

import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.system.bench.guest import load_modules

REPORT = Path("/run/bench")
INFANT = "/opt/infant/.venv/bin/infant"
RUNS = Path("/var/lib/infant/runs")
ROVER = Path("/etc/infant/rover.toml")
UNIT = "infant.service"
PTRACE_SEIZE, PTRACE_INTERRUPT, WALL = 0x4206, 0x4207, 0x40000000
DESK = """
[vehicle]
wheel_radius_left_m = 0.125
wheel_radius_right_m = 0.125
tread_m = 0.5
counts_per_rev = 4096
[laser]
url = "tcp://127.0.0.1:10940"
[encoders.bus]
interface = "socketcan"
channel = "vcan0"
[slam.mount]
x_m = 0.3
"""
SIMULATED = DESK + "[simulation.laser]\nport = 10940\n[simulation.world]\nseed = 1\n"
SERVICE = DESK + f'[record]\nfolder = "{RUNS}"\n'


def report(name: str, **values: Any) -> None:
    """One result, kept through the end of this machine."""
    with (REPORT / "results.jsonl").open("a") as file:
        file.write(json.dumps({"name": name, **values}) + "\n")
        file.flush()
        os.fsync(file.fileno())


def shell(command: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(command, shell=True, capture_output=True, text=True, check=False)


def shown(name: str) -> str:
    """One property of the unit."""
    return shell(f"systemctl show {UNIT} -p {name} --value").stdout.strip()


def facts() -> dict[str, str]:
    names = ("ActiveState", "SubState", "Result", "NRestarts", "ExecMainCode", "ExecMainStatus", "StatusText")
    told = shell(f"systemctl show {UNIT} -p " + ",".join(names)).stdout
    return dict(line.split("=", 1) for line in told.splitlines() if "=" in line)


def until(condition: Callable[[], bool], limit_s: float) -> float:
    """Seconds until it was so; -1 after the limit."""
    start = time.monotonic()
    while time.monotonic() - start < limit_s:
        if condition():
            return round(time.monotonic() - start, 2)
        time.sleep(0.05)
    return -1.0


def main_pid() -> int:
    return int(shown("MainPID") or 0)


def says(text: str) -> bool:
    return text in shown("StatusText")


def is_ticking() -> bool:
    return shown("ActiveState") == "active" and says("tick ")


def start() -> float:
    """Seconds until the service is active and tells of its ticks; 0 if it does already, -1 if it never does."""
    shell(f"systemctl reset-failed {UNIT}; systemctl start --no-block {UNIT}")
    return until(is_ticking, 90.0)


def stop() -> None:
    shell(f"systemctl stop {UNIT}")


def journal(since: float) -> str:
    return shell(f"journalctl -u {UNIT} --since=@{since:.3f} --no-pager -o cat").stdout


def newest_run() -> Path:
    return max(RUNS.iterdir(), key=lambda path: path.stat().st_mtime_ns)


def last_tick_ns(run: Path) -> int:
    """Stamp of the last tick that the record holds, on this machine's monotonic clock."""
    from runtime.record.reader import RunReader

    return max(recorded.tick.stamp_ns for recorded in RunReader(run).ticks())


def verified(run: Path) -> dict[str, Any]:
    done = shell(f"{INFANT} log verify {run} --json")
    return {"code": done.returncode, "said": (done.stdout + done.stderr)[-600:]}


def hold_thread(thread: int) -> "subprocess.Popen[bytes]":
    """Stop one thread of a process, as a deadlock would; the others go on. Ends with the thread."""
    command = [sys.executable, "-m", "tests.system.bench.systemd_guest", "hold", str(thread)]
    return subprocess.Popen(command, stdout=subprocess.PIPE)


def hold(thread: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    for request in (PTRACE_SEIZE, PTRACE_INTERRUPT):
        if libc.ptrace(request, thread, None, None):
            raise OSError(ctypes.get_errno(), "ptrace")
    sys.stdout.write(f"{time.monotonic_ns()}\n")
    sys.stdout.flush()
    while True:  # it stops, stays so, and is reaped here first when it is killed
        _, status = os.waitpid(thread, WALL)
        if os.WIFEXITED(status) or os.WIFSIGNALED(status):
            return


def installation() -> None:
    ROVER.parent.mkdir(parents=True, exist_ok=True)
    ROVER.write_text(SERVICE)
    began = time.monotonic()
    first = shell(f"{INFANT} install --json")
    seconds = time.monotonic() - began
    if first.returncode == 0 and not (REPORT / "kernels.tar").exists():
        shell(f"tar -C /var/cache/infant -cf {REPORT}/kernels.tar kernels")
    second = shell(f"{INFANT} install --json")
    states = [sorted({each["state"] for each in json.loads(done.stdout)["files"]}) for done in (first, second)]
    report(
        "installation",
        codes=[first.returncode, second.returncode],
        states=states,
        seconds=seconds,
        said=(first.stderr + second.stderr)[-600:],
        enabled=shell(f"systemctl is-enabled {UNIT}").stdout.strip(),
        kept=ROVER.read_text() == SERVICE,
        user=shell("id infant").stdout.strip(),
    )


def ordinary_day() -> None:
    began = time.time()
    ready_s = start()
    pid = main_pid()
    threads = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        threads[task.name] = [os.sched_getscheduler(int(task.name)) & ~os.SCHED_RESET_ON_FORK, task.name == str(pid)]
    status = Path(f"/proc/{pid}/status").read_text()
    locked_kb = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmLck"))
    time.sleep(5.0)
    report(
        "ordinary",
        ready_s=ready_s,
        fifo=[main for policy, main in threads.values() if policy == os.SCHED_FIFO],
        locked_kb=locked_kb,
        facts=facts(),
        journal=journal(began)[-1500:],
        threads=len(threads),
    )


def bus_goes_and_comes() -> None:
    pid = main_pid()
    shell("ip link del vcan0")
    lost_s = until(lambda: says("encoders failed: CAN bus"), 20.0)
    until(lambda: says("ip link add"), 20.0)  # it is down for a moment before it is gone
    said = shown("StatusText")
    time.sleep(3.0)
    shell("ip link add vcan0 type vcan && ip link set vcan0 up")
    back_s = until(lambda: is_ticking() and not says("encoders"), 30.0)
    report("bus", lost_s=lost_s, back_s=back_s, said=said, same=pid == main_pid(), facts=facts())


def sigterm() -> None:
    stop()
    run = newest_run()
    summary = json.loads((run / "summary.json").read_text()) if (run / "summary.json").exists() else {}
    report("sigterm", facts=facts(), verified=verified(run), summary=summary)


def thread_hangs(name: str, thread_of: Callable[[int], int], limit_s: float) -> None:
    """One thread stops for good: what systemd does, and what the record of that run holds."""
    start()
    time.sleep(3.0)
    pid, run, began = main_pid(), newest_run(), time.time()
    restarts = int(shown("NRestarts"))
    holder = hold_thread(thread_of(pid))
    assert holder.stdout is not None
    held_ns = int(holder.stdout.readline())
    killed_s = until(lambda: not Path(f"/proc/{pid}").exists(), limit_s)
    back_s = until(is_ticking, 90.0)
    holder.kill()
    holder.wait()
    report(
        name,
        killed_s=killed_s,
        back_s=back_s,
        restarts=int(shown("NRestarts")) - restarts,
        journal=journal(began)[-2000:],
        lost_s=(held_ns - last_tick_ns(run)) * 1e-9,
        verified=verified(run),
        facts=facts(),
    )


def reader_thread(pid: int) -> int:
    """A thread of a sensor: these are started last, and the kernel knows them by the program's name."""
    tasks = sorted(Path(f"/proc/{pid}/task").iterdir(), key=lambda path: int(path.name))
    ours = [int(task.name) for task in tasks if (task / "comm").read_text().strip() == "infant"]
    return ours[-2]


def crash_loop() -> None:
    shell(f"systemctl reset-failed {UNIT}; systemctl start --no-block {UNIT}")
    began, starts, last = time.time(), 0, 0  # the one that runs already is the first
    while shown("ActiveState") != "failed" and time.time() - began < 200.0:
        pid = main_pid()
        if pid not in (0, last):
            last, starts = pid, starts + 1
            try:
                os.kill(pid, signal.SIGSEGV)
            except ProcessLookupError:
                continue
        time.sleep(0.02)
    limit = facts()
    words = journal(began)[-800:]
    again_s = start()
    report("crashes", starts=starts, facts=limit, journal=words, again_s=again_s)


def never_ready() -> None:
    """It stops before READY=1. The unit's 60 s are cut to 8 s for this trial, nothing else of it is changed."""
    drop_in = Path(f"/run/systemd/system/{UNIT}.d/short.conf")
    drop_in.parent.mkdir(parents=True)
    drop_in.write_text("[Service]\nTimeoutStartSec=8s\n")
    shell(f"systemctl daemon-reload; systemctl reset-failed {UNIT}")
    stop()
    began = time.time()
    shell(f"systemctl start --no-block {UNIT}")
    until(lambda: main_pid() != 0, 20.0)
    pid = main_pid()
    time.sleep(0.5)
    os.kill(pid, signal.SIGSTOP)
    gone_s = until(lambda: not Path(f"/proc/{pid}").exists(), 60.0)
    shutil.rmtree(drop_in.parent)
    shell("systemctl daemon-reload")
    back_s = until(is_ticking, 90.0)
    report("never_ready", gone_s=gone_s, back_s=back_s, journal=journal(began)[-1500:], facts=facts())
    stop()


def bad_configuration() -> None:
    ROVER.write_text(SERVICE.replace("vcan0", 'vcan0"\nbit_rate = "fast'))
    began = time.time()
    shell(f"systemctl reset-failed {UNIT}; systemctl start --no-block {UNIT}")
    until(lambda: shown("ActiveState") == "failed", 30.0)
    time.sleep(3.0)  # longer than RestartSec: it must stay down
    report("bad_configuration", facts=facts(), journal=journal(began)[-800:])
    ROVER.write_text(SERVICE)


def until_the_power_goes() -> None:
    """Tell the time, again and again; the host ends this machine at some moment."""
    report("power", ready_s=start(), run=str(newest_run()))
    alive = os.open(REPORT / "alive", os.O_WRONLY | os.O_CREAT)
    while True:
        os.pwrite(alive, b"%020d" % time.monotonic_ns(), 0)
        time.sleep(0.01)


def after_the_power_came_back() -> None:
    results = [json.loads(line) for line in (REPORT / "results.jsonl").read_text().splitlines()]
    run = Path(next(result["run"] for result in results if result["name"] == "power"))
    by_itself_s = until(lambda: shown("ActiveState") == "active", 240.0)
    alive_ns = int((REPORT / "alive").read_text())
    report(
        "power_is_back",
        by_itself_s=by_itself_s,
        lost_s=(alive_ns - last_tick_ns(run)) * 1e-9,
        verified=verified(run),
        facts=facts(),
    )
    stop()


def first_boot() -> None:
    """Everything up to the loss of power."""
    load_modules(Path(os.environ["BENCH_ROOT"]))
    shell("ip link add vcan0 type vcan && ip link set vcan0 up")
    installation()
    desk = Path("/run/desk.toml")
    desk.write_text(SIMULATED)
    with subprocess.Popen([INFANT, "sim", "--config", str(desk)], stdout=subprocess.PIPE) as rover:
        assert rover.stdout is not None
        rover.stdout.readline()
        ordinary_day()
        bus_goes_and_comes()
        sigterm()
        thread_hangs("loop_hangs", lambda pid: pid, 30.0)
        thread_hangs("reader_hangs", reader_thread, 60.0)
        crash_loop()
        never_ready()
        bad_configuration()
        until_the_power_goes()


if __name__ == "__main__":
    os.environ["PATH"] = "/usr/sbin:/usr/bin:/sbin:/bin"
    match sys.argv[1:]:
        case ["hold", thread]:
            hold(int(thread))
        case ["again"]:
            after_the_power_came_back()
        case _:
            first_boot()
