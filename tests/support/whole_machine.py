"""A container of the systemd rig as a whole machine, with the project where every user sees it."""

import sys
from importlib.metadata import distribution
from pathlib import Path

PROJECT = Path(__file__).parents[2]
PACKAGES = distribution("msgspec").locate_file("")


def whole_machine(rig_type):
    """The rig, with a /usr that can be written; what is written there is gone afterwards.

    The units' users may not see where the project usually lies: it is at /opt/source, too, its
    packages at /opt/packages and this Python at /opt/python. The network is its own, because what
    else runs on this computer may listen at the port that the configuration says.
    """

    class WholeMachine(rig_type):
        def command(self, script, folder, *also):
            words = super().command(script, folder, *also)
            places = {PROJECT: "source", PACKAGES: "packages", sys.base_prefix: "python"}
            binds = [f"--bind-ro={place}:/opt/{name}" for place, name in places.items()]
            at = words.index("--boot")
            return [*words[:at], "--overlay=/usr::/usr", "--private-network", *binds, *words[at:]]

    return WholeMachine()
