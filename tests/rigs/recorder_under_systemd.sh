# The recorder as `make install-record` leaves it, beside a service that is played from a ring.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
minor=$(ls -d /opt/python/lib/python3.* | head -1 | xargs basename)
python=/usr/bin/$minor
[ -x $python ] || python=/opt/python/bin/python3
$python -m venv --without-pip /opt/gaitd-here
ln -s /opt/gaitd-here /opt/gaitd
printf '/opt/source\n/opt/source/clients/%s\n' python record > /opt/gaitd/lib/$minor/site-packages/here.pth
printf '/opt/packages\n' >> /opt/gaitd/lib/$minor/site-packages/here.pth
printf '#!/opt/gaitd/bin/python\nfrom gaitd.__main__ import main\nmain()\n' > /opt/gaitd/bin/gaitd
chmod 755 /opt/gaitd/bin/gaitd
bash /opt/source/scripts/install.sh record-files > install
{ systemctl is-enabled gaitd-record; systemctl is-active gaitd-record; } > before || true
sed -i 's/--for training/--for all/' /etc/gaitd-record/record.env

/opt/gaitd/bin/gaitd replay /opt/source/gaitd/sample.ring.xz --publish --repeat > played 2>&1 &
recorded() {
    # By the content: a recording that has estimates of its own.
    until ls /var/lib/gaitd-record/*.part/right.arrows > /dev/null 2>&1; do sleep 0.1; done
    sleep 2
}
systemctl start gaitd-record
recorded
systemctl kill --signal=KILL gaitd-record
until journalctl -u gaitd-record -o cat | grep -q 'torn: the recorder was killed'; do sleep 0.1; done
recorded
systemctl stop gaitd-record
systemctl show --value --property=Result,ExecMainStatus gaitd-record > result
journalctl -u gaitd-record -o cat > journal
find /var/lib/gaitd-record -type f > left
find /var/lib/gaitd-record -type f -printf '%u %m\n' > owners
/opt/gaitd/bin/gaitd replay "$(ls -d /var/lib/gaitd-record/* | tail -1)" --output replayed.csv > replayed
