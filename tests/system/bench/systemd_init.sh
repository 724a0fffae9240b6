#!/bin/sh
# The first process of the guest until systemd takes its place: the host's programs read-only, /etc, /var and /opt on a
# disk of its own (so that they outlive a loss of power), the checkout at /opt/infant as an engineer would have it.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs -o mode=0755 tmpfs /run
mkdir /run/disk /run/bench
mount -t ext4 /dev/ubda /run/disk || exit 1
mount -t hostfs -o "$BENCH_REPORT" none /run/bench
disk=/run/disk
if [ ! -d $disk/etc ]; then
    mkdir -p $disk/etc/systemd/system $disk/etc/systemd/journald.conf.d $disk/var/tmp $disk/var/log/journal $disk/var/lib $disk/var/cache \
        $disk/opt/infant $disk/opt/python $disk/opt/site
    chmod 1777 $disk/var/tmp
    ln -s /run $disk/var/run
    for each in ld.so.cache nsswitch.conf alternatives localtime os-release ssl; do
        cp -a /etc/$each $disk/etc/ 2>/dev/null
    done
    echo "root:x:0:0:root:/root:/bin/sh" > $disk/etc/passwd
    printf 'root:x:0:\ndialout:x:20:\nsystemd-journal:x:101:\n' > $disk/etc/group
    echo "127.0.0.1 localhost" > $disk/etc/hosts
    echo bench > $disk/etc/hostname
    : > $disk/etc/fstab
    echo 0123456789abcdef0123456789abcdef > $disk/etc/machine-id
    printf '[Journal]\nStorage=persistent\nSyncIntervalSec=1s\nRateLimitIntervalSec=0\n' \
        > $disk/etc/systemd/journald.conf.d/bench.conf
    # what a machine of one service without hardware does not need, and what would take most of the boot
    for unit in dbus.service dbus.socket systemd-logind.service systemd-user-sessions.service getty.target \
        systemd-update-utmp.service systemd-update-utmp-runlevel.service systemd-random-seed.service \
        systemd-binfmt.service systemd-firstboot.service systemd-machine-id-commit.service systemd-sysusers.service \
        systemd-remount-fs.service systemd-timesyncd.service systemd-tmpfiles-setup-dev.service systemd-tmpfiles-setup.service \
        systemd-modules-load.service systemd-sysctl.service systemd-pstore.service systemd-ask-password-console.path systemd-ask-password-wall.path \
        systemd-initctl.socket systemd-tmpfiles-clean.timer kmod-static-nodes.service dev-hugepages.mount \
        dev-mqueue.mount proc-sys-fs-binfmt_misc.automount sys-fs-fuse-connections.mount sys-kernel-config.mount \
        sys-kernel-debug.mount sys-kernel-tracing.mount cryptsetup.target integritysetup.target veritysetup.target; do
        ln -s /dev/null $disk/etc/systemd/system/$unit
    done
fi
mount --bind $disk/etc /etc
mount --bind $disk/var /var
mount --bind $disk/opt /opt
mount --bind -o ro "$BENCH_BASE" /opt/python
mount --bind -o ro "$BENCH_SITE" /opt/site
tree=/opt/infant/tree
if [ ! -d $tree ]; then
    mkdir -p $tree
    for each in config drivers runtime slam systemd tests; do cp -r "$BENCH_TREE/$each" $tree/; done
    find $tree -name __pycache__ -prune -exec rm -r {} +
    # compiled kernels are kept from bench to bench; they are taken only where the sources have the same dates
    find $tree -exec touch -d 2020-01-01 {} +
fi
kernels=/run/bench/kernels.tar
if [ -e $kernels ] && [ ! -d /var/cache/infant ]; then mkdir -p /var/cache/infant && tar -C /var/cache/infant -xf $kernels; fi
mount -t tmpfs -o mode=1777 tmpfs /tmp
venv=/opt/infant/.venv
if [ ! -d $venv ]; then
    mkdir -p $venv/bin $venv/lib/python$BENCH_PYTHON/site-packages
    printf 'home = /opt/python/bin\ninclude-system-site-packages = false\n' > $venv/pyvenv.cfg
    ln -s /opt/python/bin/python$BENCH_PYTHON $venv/bin/python
    printf '/opt/infant/tree\n/opt/site\n' > $venv/lib/python$BENCH_PYTHON/site-packages/bench.pth
    printf '#!%s\nimport sys\nfrom runtime.cli import main\nsys.exit(main())\n' $venv/bin/python > $venv/bin/infant
    chmod 755 $venv/bin/infant
fi
cat > /etc/systemd/system/bench.service <<UNIT
[Unit]
Description=The bench
After=basic.target
[Service]
Type=exec
ExecStart=/bin/sh /run/bench/guest.sh
StandardOutput=file:/run/bench/said
StandardError=inherit
WorkingDirectory=/opt/infant/tree
Environment=BENCH_ROOT=$BENCH_ROOT
UNIT
cat > /etc/systemd/system/bench.target <<UNIT
[Unit]
Requires=basic.target multi-user.target
Wants=bench.service
UNIT
hostname bench
ip link set lo up
exec /lib/systemd/systemd --unit=bench.target
