"""Who could reach an endpoint."""

import pytest

from daemon.zenoh_io.endpoints import is_local, refused, to_connect


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tls/127.8.9.1:7447",
        "tcp/[::1]:7447",
        "ws/localhost:80",
        "udp/127.0.0.1:7447#iface=lo",
        "unixsock-stream//run/gaitd/zenoh.sock",
    ],
)
def test_loopback_and_unix_sockets_are_local(endpoint):
    assert is_local(endpoint)


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tls/192.168.1.4:7447", "tcp/trainer.local:7447"],
)
def test_an_endpoint_beyond_loopback_is_refused_unless_it_is_allowed(endpoint):
    listen = ("tcp/127.0.0.1:7447", endpoint)

    assert refused(listen, beyond_loopback=False) == (1, endpoint)
    assert refused(listen, beyond_loopback=True) is None


def test_a_client_on_the_same_machine_connects_to_loopback():
    assert to_connect("tcp/0.0.0.0:7447") == "tcp/127.0.0.1:7447"
    assert to_connect("tls/[::]:7447") == "tls/[::1]:7447"
    assert to_connect("tcp/127.0.0.1:7447") == "tcp/127.0.0.1:7447"
    assert to_connect("unixsock-stream//run/x.sock") == "unixsock-stream//run/x.sock"
