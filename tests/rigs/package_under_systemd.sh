# The Debian package in a container: installed, upgraded, removed, purged. What is seen goes into files,
# which test_package_under_systemd.py reads. $project is the repository; the packages are beside this.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8
cp -a /srv/dpkg/. /var/lib/dpkg/
: > /var/lib/dpkg/statoverride # of users that this container lacks
parts="gaitd-core gaitd-gateway"

package() {  # NAME WORDS...: dpkg with these words; output and result go into NAME
    local name=$1
    shift
    dpkg --force-confold --force-unsafe-io "$@" > "$name" 2>&1 || echo "failed" >> "$name"
    dpkg-query --show --showformat='${db:Status-Status} ${Version}\n' gaitd >> "$name" || true
}

is() {  # NAME: what is installed and running
    {
        /opt/gaitd/bin/gaitd --version
        dpkg --verify gaitd | grep -v ' c /etc/gaitd/\(trainer\|demo\).toml$' || true
        find /etc -name '*.dpkg-*'
        echo "environments: $(ls /opt)"
        systemctl show --property=MainPID,NRestarts,ActiveState $parts
    } > "$1" 2>&1
}

laboratory() {  # the virtual drives, which the package does not have
    /opt/gaitd/bin/python -m pip install --quiet --disable-pip-version-check --no-index --no-deps gaitd_lab-*.whl
}

package install --install first.deb
{
    systemctl is-enabled gaitd.target $parts gaitd-patient gaitd-therapist gaitd-assist gaitd-record
    systemctl is-active gaitd.target $parts gaitd-patient gaitd-therapist gaitd-assist gaitd-record
} > after_install || true
is installed
stat -c '%U %G %a' /etc/gaitd/trainer.toml /etc/gaitd-display/patient.toml /etc/gaitd-assist/assist.toml \
    /etc/gaitd-record/record.env > owners
{ ls /usr/share/man/man1 /usr/share/bash-completion/completions /usr/share/zsh/vendor-completions | grep gaitd; } > manual
find /var/cache/gaitd -name '*.nbc' | wc -l > compiled

laboratory
. "$project/tests/rigs/simulated_bus.sh"
systemctl start gaitd-sim $parts
is running
package upgrade_of_a_running --install second.deb
package removal_of_a_running --remove gaitd
is still_running
systemctl stop gaitd.target gaitd-sim $parts
/opt/gaitd/bin/python -c 'import time, numpy; open("by_hand", "w"); time.sleep(3600)' &
until [ -e by_hand ]; do sleep 0.1; done
package upgrade_beside_a_process --install second.deb
kill $!

is before
package refused --install third.deb
is after_refused
systemctl start gaitd-sim $parts
systemctl stop gaitd.target gaitd-sim $parts

cp /etc/gaitd/trainer.toml edited.toml
package upgraded --install second.deb
is after_upgrade
cmp edited.toml /etc/gaitd/trainer.toml > edited
grep -c counts_per_revolution /etc/gaitd/drives/hip_epos4.toml > replaced || true
laboratory
systemctl start gaitd-sim $parts
is runs_again
systemctl enable --quiet gaitd.target
systemctl stop gaitd.target gaitd-sim $parts

ours() {
    find / -xdev \( -path /proc -o -path /sys -o -path "$project" -o -path "$PWD" -o -path /srv -o -path /run/systemd \
        -o -path /var/log -o -path /tmp -o -path /var/lib/dpkg \) -prune -o -name '*gaitd*' -print | sort
    ls /opt
}
without_virtual_drives
package removed --remove gaitd
ours > left_by_removal
package purged --purge gaitd
ours > left_by_purge
getent passwd gaitd-core gaitd-gateway gaitd-patient gaitd-therapist gaitd-assist gaitd-record >> left_by_purge || true
getent group gaitd gaitd-training gaitd-patient gaitd-therapist gaitd-assist gaitd-record >> left_by_purge || true
