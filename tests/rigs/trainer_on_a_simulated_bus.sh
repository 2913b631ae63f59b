# A trainer as `make install` leaves it, in a container: gaitd in /opt/gaitd, its files where they
# belong. The bus is the simulated one, because a container has no SocketCAN of its own.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
# Debian's own Python where it is of our version: another one may have libraries that /opt lacks.
minor=$(ls -d /opt/python/lib/python3.* | head -1 | xargs basename)
python=/usr/bin/$minor
[ -x $python ] || python=/opt/python/bin/python3
$python -m venv --without-pip /opt/gaitd-here
ln -s /opt/gaitd-here /opt/gaitd
printf '/opt/source\n/opt/source/clients/%s\n' python session display > /opt/gaitd/lib/$minor/site-packages/here.pth
printf '/opt/packages\n' >> /opt/gaitd/lib/$minor/site-packages/here.pth
printf '#!/opt/gaitd/bin/python\nfrom gaitd.__main__ import main\nmain()\n' > /opt/gaitd/bin/gaitd
printf '#!/opt/gaitd/bin/python\nfrom gaitd_display.__main__ import main\nmain()\n' > /opt/gaitd/bin/gaitd-display
chmod 755 /opt/gaitd/bin/gaitd /opt/gaitd/bin/gaitd-display

bash /opt/source/scripts/install.sh files > install
parts="gaitd.target gaitd-core gaitd-gateway gaitd-sim"
{ systemctl is-enabled $parts; systemctl is-active $parts; } > after_install || true
bash /opt/source/scripts/install.sh display-files > install_display

# The desk's bus, and virtual drives that have never been commissioned. A quick start of a gait.
examples=/usr/share/doc/gaitd/examples units=/etc/systemd/system
install -D -m 644 $examples/bus-simulated.conf $units/gaitd-core.service.d/20-gaitd-bus.conf
# A container cannot raise its limits; systemd gives the processes their priority in here.
real_time() {
    mkdir -p $units/gaitd-$1.service.d
    printf '[Service]\nLimitRTPRIO=0\nLimitMEMLOCK=8M\nCPUSchedulingPolicy=fifo\nCPUSchedulingPriority=%s\n' $2 \
        > $units/gaitd-$1.service.d/50-container.conf
}
real_time core 50
real_time sim 40
sed 's#/etc/gaitd/vcan.toml#/etc/gaitd/demo.toml --wall-clock#; /^ExecStart=/!d' /usr/lib/systemd/system/gaitd-sim.service |
    sed '1i [Service]\nExecStart=' > $units/gaitd-sim.service.d/60-desk.conf
# By the computer's clock: here systemd watches the core.
bus='s#^interface = .*#interface = "simulated"#; s#^channel = .*#channel = "/run/gaitd-sim/bus"#'
sed -i -e "$bus" /etc/gaitd/demo.toml
sed -i -e "$bus" \
    -e 's/signs = "proven"/signs = "assumed"/; s/without_stored_pose = "home"/without_stored_pose = "believe"/' \
    -e 's/required = "daily"/required = "never"/; s/announce_s = 3.0/announce_s = 0.5/' \
    -e 's/pose_tolerance_deg = .*/pose_tolerance_deg = 180.0/; s/pose_tolerance_m = .*/pose_tolerance_m = 2.0/' \
    -e 's/ramp_strides = 2/ramp_strides = 1/' /etc/gaitd/trainer.toml

# An upgrade: the same files once more, over a configuration that was edited.
cp /etc/gaitd/trainer.toml edited.toml
bash /opt/source/scripts/install.sh files > upgrade
cmp edited.toml /etc/gaitd/trainer.toml && cmp /opt/source/configs/trainer.toml /etc/gaitd/trainer.toml.dist &&
    echo kept >> upgrade

# The virtual drives compile for the first time here, and not at real-time priority.
install -d -o gaitd-sim -g gaitd /var/cache/gaitd-sim /run/gaitd-sim
setpriv --reuid=gaitd-sim --regid=gaitd --clear-groups env -C / NUMBA_CACHE_DIR=/var/cache/gaitd-sim \
    /opt/gaitd/bin/gaitd sim --config /etc/gaitd/demo.toml --wall-clock --duration 0.1
