"""Tests on a real kernel with SocketCAN, booted as a plain process (User-Mode Linux): `make system`.

Anyone can run them on an x86-64 Debian with apt-get and, on CPUs with AMX, gcc; the packages user-mode-linux and
can-utils are downloaded once into ~/.cache/infant-bench (or INFANT_BENCH) and unpacked, not installed. Where that
cannot be had, the tests skip and say why. No privilege is needed on the host: inside the guest everything is root, the
host's files are read-only, and vcan, slcan and the system clock are the guest's own.

test_can_bench.py   the reader alone, each trouble once
test_fault_bench.py rows of the fault table that only a kernel can make, a hundred times each
test_run_bench.py   `infant run` as it is typed, the simulated rover in another process, the record read afterwards

One of them by hand: .venv/bin/python -m pytest -m system tests/system/test_run_bench.py
"""
