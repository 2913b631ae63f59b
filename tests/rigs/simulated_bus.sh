# Sourced inside the container, after an installation.
# The desk's bus, and virtual drives that have never been commissioned. A quick start of a gait.
# Bus and drives are the examples of docs/installation.md; the drives are taken away by `without_virtual_drives`.
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
sed 's#/etc/gaitd/vcan.toml#/etc/gaitd/demo.toml --wall-clock#' $examples/gaitd-sim.service > $units/gaitd-sim.service
install -m 644 /usr/lib/systemd/system/gaitd-core.service.d/10-gaitd-no-can.conf $units/gaitd-sim.service.d/
systemd-sysusers $examples/gaitd-sim.sysusers
systemctl daemon-reload
without_virtual_drives() {
    rm -rf $units/gaitd-sim.service $units/gaitd-sim.service.d /var/cache/gaitd-sim /run/gaitd-sim
    userdel gaitd-sim
    systemctl daemon-reload
}
# By the computer's clock: here systemd watches the core.
bus='s#^interface = .*#interface = "simulated"#; s#^channel = .*#channel = "/run/gaitd-sim/bus"#'
sed -i -e "$bus" /etc/gaitd/demo.toml
sed -i -e "$bus" \
    -e 's/signs = "proven"/signs = "assumed"/; s/without_stored_pose = "home"/without_stored_pose = "believe"/' \
    -e 's/required = "daily"/required = "never"/; s/announce_s = 3.0/announce_s = 0.5/' \
    -e 's/hip.pose_tolerance_deg = .*/hip.pose_tolerance_deg = 180.0/; s/slide.pose_tolerance_m = .*/slide.pose_tolerance_m = 2.0/' \
    -e 's/ramp_strides = 2/ramp_strides = 1/' /etc/gaitd/trainer.toml

# The virtual drives compile for the first time here, and not at real-time priority.
install -d -o gaitd-sim -g gaitd /var/cache/gaitd-sim /run/gaitd-sim
setpriv --reuid=gaitd-sim --regid=gaitd --clear-groups env -C / NUMBA_CACHE_DIR=/var/cache/gaitd-sim \
    /opt/gaitd/bin/gaitd sim --config /etc/gaitd/demo.toml --wall-clock --duration 0.1
