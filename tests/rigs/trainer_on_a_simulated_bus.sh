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
parts="gaitd.target gaitd-core gaitd-gateway"
{ systemctl is-enabled $parts; systemctl is-active $parts; } > after_install || true
bash /opt/source/scripts/install.sh display-files > install_display

. /opt/source/tests/rigs/simulated_bus.sh

# An upgrade: the same files once more, over a configuration that was edited.
cp /etc/gaitd/trainer.toml edited.toml
bash /opt/source/scripts/install.sh files > upgrade
cmp edited.toml /etc/gaitd/trainer.toml && cmp /opt/source/configs/trainer.toml /etc/gaitd/trainer.toml.dist &&
    echo kept >> upgrade
