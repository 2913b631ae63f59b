# The end of the same container: what an uninstall and a purge leave behind.
systemctl start gaitd-sim gaitd.target
systemctl enable --quiet gaitd.target
bash /opt/source/scripts/install.sh files > while_it_runs 2>&1 || true
systemctl stop gaitd-sim gaitd.target gaitd-core gaitd-gateway
systemctl start gaitd-therapist
bash /opt/source/scripts/install.sh files > while_a_page_runs 2>&1 || true
without_virtual_drives
bash /opt/source/scripts/install.sh uninstall > uninstall
systemctl show --value --property=LoadState gaitd.target gaitd-core gaitd-gateway > loaded
ours() {
    # Not ours to remove: what is bound into the container, logs, what systemd and the probes keep in /run.
    find / -xdev \( -path /proc -o -path /sys -o -path /opt/source -o -path /opt/packages -o -path /opt/python \
        -o -path /run/systemd -o -path /var/log -o -path /tmp \) -prune -o -name '*gaitd*' -print | sort
}
ours > left_by_uninstall
ls /etc/gaitd/trainer.toml /var/lib/gaitd/axes.json /var/lib/gaitd/requests.jsonl > kept
bash /opt/source/scripts/install.sh purge > purge
ours > left_by_purge
getent passwd gaitd-core gaitd-gateway gaitd-patient gaitd-therapist gaitd-assist gaitd-record >> left_by_purge || true
getent group gaitd gaitd-training gaitd-patient gaitd-therapist gaitd-assist gaitd-record >> left_by_purge || true
