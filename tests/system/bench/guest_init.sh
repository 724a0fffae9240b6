#!/bin/sh
# First and only process of the User-Mode Linux guest: the host's file system read-only, a few of its own on top.
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs tmpfs /run
mkdir -p /dev/shm && mount -t tmpfs tmpfs /dev/shm
mkdir -p /dev/pts && mount -t devpts devpts /dev/pts
ip link set lo up
if [ -n "$BENCH_OUT" ]; then
    mkdir /run/out && mount -t hostfs none /run/out -o "$BENCH_OUT"
fi
cd "$BENCH_TREE" || exit 1
PYTHONDONTWRITEBYTECODE=1 PATH="$BENCH_ROOT/usr/bin:/usr/sbin:/usr/bin:/sbin:/bin" \
    "$BENCH_PYTHON" -m "tests.system.bench.$BENCH_PROGRAM" "$BENCH_ROOT"
echo "RESULT {\"name\": \"exit\", \"code\": $?}"
echo o > /proc/sysrq-trigger
sleep 5
