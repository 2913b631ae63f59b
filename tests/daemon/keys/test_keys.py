"""The folder of keys: what is written, who may read it, and what is refused, by OpenSSL too."""

import datetime
import json
import ssl

import pytest
from command_line import gaitd
from config_files import CONFIGS
from gaitd_client.credentials import read_credentials
from gaitd_toml import ConfigError
from power_cuts import check
from traced_calls import mark

from daemon.keys import issuing
from daemon.keys.folder import read_keys
from daemon.zenoh_io.access import access_control

NOW = datetime.datetime(2026, 11, 23, tzinfo=datetime.UTC)
LOCAL, REMOTE = "tcp/127.0.0.1:7447", "tls/trainer.lan:7448"


@pytest.fixture
def folder(tmp_path):
    issuing.init(tmp_path / "keys", "trainer", ["trainer.lan"], NOW, 365)
    return tmp_path / "keys"


def issue(folder, name, *, remote=False):
    endpoint = REMOTE if remote else LOCAL
    return issuing.issue(folder, name, [endpoint], "trainer", NOW, 365, remote=remote)


def handshake(server, client, host):
    """Both ends of TLS by OpenSSL, in memory; the client's common name as the server sees it."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ours = server.wrap_bio(to_server, to_client, server_side=True)
    theirs = client.wrap_bio(to_client, to_server, server_hostname=host)
    done = {ours: False, theirs: False}
    while not all(done.values()):
        for end in (theirs, ours):
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
            done[end] = True
    subject = dict(part[0] for part in ours.getpeercert()["subject"])
    return subject["commonName"]


def contexts(folder, bundle):
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(folder / "gateway.pem", folder / "gateway.key")
    server.load_verify_locations(folder / "authority.pem")
    server.verify_mode = ssl.CERT_REQUIRED
    client = ssl.create_default_context(cafile=str(bundle / "authority.pem"))
    client.load_cert_chain(bundle / "client.pem", bundle / "client.key")
    client.verify_flags |= ssl.VERIFY_X509_STRICT
    server.verify_flags |= ssl.VERIFY_X509_STRICT
    return server, client


@pytest.mark.parametrize("host", ["trainer.lan", "localhost", "127.0.0.1"])
def test_openssl_accepts_both_certificates_and_reads_the_clients_name(folder, host):
    bundle = issue(folder, "session.ward_3", remote=True)

    assert handshake(*contexts(folder, bundle), host) == "session.ward_3"


def test_openssl_refuses_a_host_that_the_gateway_is_not(folder):
    bundle = issue(folder, "session.ward_3", remote=True)

    with pytest.raises(ssl.SSLCertVerificationError, match="Hostname mismatch"):
        handshake(*contexts(folder, bundle), "another.lan")


def test_only_the_owner_may_read_what_is_written(folder):
    issue(folder, "session.ward_3", remote=True)
    issue(folder, "display.desk")

    files = [path for path in folder.rglob("*") if path.is_file()]
    assert {path.name for path in files} >= {"clients.json", "gateway.key", "client.key"}
    assert {f"{path.stat().st_mode & 0o777:o}" for path in files} == {"600"}
    assert {
        f"{p.stat().st_mode & 0o777:o}" for p in (folder, *folder.rglob("*")) if p.is_dir()
    } == {"700"}


def test_each_client_has_a_password_of_its_own_and_a_new_one_when_renewed(folder):
    first = read_credentials(issue(folder, "display.desk")).file.password
    other = read_credentials(issue(folder, "session.desk")).file.password
    second = read_credentials(issue(folder, "display.desk")).file.password

    assert len({first, other, second}) == 3
    assert [(one.name, one.password) for one in read_keys(folder).register.clients] == [
        ("session.desk", other),
        ("display.desk", second),
    ]
    assert read_credentials(folder / "issued" / "display.desk.before").file.password == first


def test_a_revoked_client_leaves_nothing(folder):
    issue(folder, "display.desk")
    issue(folder, "display.desk")
    issuing.revoke(folder, "display.desk")

    assert list((folder / "issued").iterdir()) == []
    assert read_keys(folder).register.clients == ()


CLIENT = {
    **{"name": "display.desk", "password": "x" * 32, "remote": False},
    **{"issued": "2026-11-23", "expires": None},
}


def changed(key, value):
    def change(folder):
        file = folder / "clients.json"
        file.write_text(json.dumps({**json.loads(file.read_text()), key: value}))

    return change


def spoiled(name, text):
    return lambda folder: folder.joinpath(name).write_text(text)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda folder: (folder / "clients.json").unlink(), "clients.json: no such file"),
        (spoiled("clients.json", "{"), "clients.json"),
        (lambda folder: (folder / "clients.json").write_bytes(b"\xff\x00"), "clients.json"),
        (changed("gateway_expires", "soon"), "gateway_expires"),
        (changed("clients", [{**CLIENT, "password": ""}]), "password"),
        (changed("clients", [{**CLIENT, "name": "nurse.x"}]), "name"),
        (changed("clients", [CLIENT, CLIENT]), "each name once"),
        (spoiled("gateway.pem", ""), r"gateway\.pem"),
        (spoiled("gateway.key", "no key"), r"gateway\.pem"),
        (lambda folder: (folder / "gateway.key").unlink(), r"gateway\.pem: no such file"),
        (spoiled("authority.pem", ""), r"authority\.pem"),
        (lambda folder: (folder / "gateway.key").chmod(0o640), 'mode = "0640"'),
        (lambda folder: (folder / "clients.json").chmod(0o604), 'mode = "0604"'),
        (lambda folder: (folder / "authority.key").chmod(0o604), 'mode = "0604"'),
    ],
)
def test_a_folder_that_cannot_be_used_is_refused_with_file_and_reason(folder, spoil, said):
    issue(folder, "display.desk")
    spoil(folder)

    with pytest.raises(ConfigError, match=said):
        read_keys(folder)


@pytest.mark.parametrize(
    "name", ["display", "display.", "nurse.x", "display.x.y", "display.x/../y", "Display.X", "a:b"]
)
def test_a_name_that_is_none_is_refused(folder, name):
    with pytest.raises(ConfigError, match=r"ROLE\.NAME"):
        issue(folder, name)


def test_no_certificate_outlives_its_authority(folder):
    later = NOW + datetime.timedelta(days=3400)

    with pytest.raises(ConfigError, match="2036-11-20"):
        issuing.issue(folder, "display.x", [REMOTE], "trainer", later, 365, remote=True)
    assert not (folder / "issued" / "display.x").exists()


def test_init_does_not_lock_out_the_clients_of_a_folder(folder):
    with pytest.raises(ConfigError, match="it exists"):
        issuing.init(folder, "trainer", [], NOW, 365)


def test_a_local_password_is_none_on_a_remote_link_and_the_reverse(folder):
    issue(folder, "display.desk")
    issue(folder, "display.ward", remote=True)
    made = access_control("trainer", read_keys(folder).register.clients)

    assert [subject for subject in made["subjects"] if subject["id"] != "any client"] == [
        {
            "id": "display.desk",
            "usernames": ["display.desk"],
            "link_protocols": ("tcp", "unixsock-stream"),
        },
        {
            "id": "display.ward",
            "usernames": ["display.ward"],
            "cert_common_names": ["display.ward"],
            "link_protocols": ("tls",),
        },
    ]


# --- the command ----------------------------------------------------------------------------------


@pytest.fixture
def config(tmp_path):
    file = tmp_path / "trainer.toml"
    text = (CONFIGS / "demo.toml").read_text()
    listen = f'listen = ["{LOCAL}", "tls/0.0.0.0:7448"]\nlisten_beyond_loopback = true\n'
    file.write_text(text.replace(f'listen = ["{LOCAL}"]', f'{listen}keys = "keys"'))
    return file


def test_the_command_makes_issues_lists_renews_and_revokes(config, tmp_path):
    assert gaitd("keys", "init", "--config", config, "--host", "trainer.lan").code == 0
    assert gaitd("keys", "issue", "operator.desk", "--config", config).code == 0
    made = gaitd(
        *("keys", "issue", "display.ward", "--remote", "--host", "trainer.lan"),
        *("--config", config),
    )
    assert made.code == 0
    before = read_credentials(tmp_path / "keys/issued/display.ward")
    assert before.file.endpoints == ("tls/trainer.lan:7448",)
    assert read_credentials(tmp_path / "keys/issued/operator.desk").file.endpoints == (LOCAL,)

    listed = json.loads(gaitd("keys", "list", "--config", config, "--json").out)
    assert [(c["name"], c["remote"], c["expires"] is None) for c in listed["clients"]] == [
        ("operator.desk", False, True),
        ("display.ward", True, False),
    ]
    hosts = issuing.remote_hosts(tmp_path / "keys")
    assert gaitd("keys", "renew", "display.ward", "--config", config).code == 0
    assert gaitd("keys", "renew", "gateway", "--config", config).code == 0
    after = read_credentials(tmp_path / "keys/issued/display.ward")
    assert after.file.password != before.file.password
    assert after.file.endpoints == before.file.endpoints
    assert issuing.remote_hosts(tmp_path / "keys") == hosts == ("trainer.lan",)
    assert gaitd("keys", "revoke", "display.ward", "--config", config).code == 0
    assert "display.ward" not in gaitd("keys", "list", "--config", config).out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("issue",), "NAME = (missing)"),
        (("issue", "nurse.x"), "nurse.x"),
        (("revoke", "display.x"), "display.x"),
        (("renew", "display.x"), "display.x"),
        (("init",), "it exists"),
        (("issue", "display.ward", "--remote"), "--host = (missing)"),
        (("renew", "gateway", "--host", "tr\xe4ner"), "--host"),
        (("issue", "display.ward", "--remote", "--host", "x"), "authority.key"),
    ],
)
def test_a_wrong_call_is_one_line_with_what_is_allowed(config, words, said):
    gaitd("keys", "init", "--config", config)
    if said == "authority.key":
        (config.parent / "keys" / "authority.key").unlink()

    refused = gaitd("keys", *words, "--config", config)

    assert refused.code == 2
    assert refused.err.startswith("configuration error: ")
    assert said in refused.err
    assert refused.err.count("\n") == 1
    assert read_keys(config.parent / "keys").register.clients == ()


@pytest.mark.parametrize(
    ("listen", "keys", "said"),
    [
        ("tls/0.0.0.0:7448", "", "zenoh.keys"),
        ("tls/127.0.0.1:7448", "", "zenoh.keys"),
        ("tcp/0.0.0.0:7448", 'keys = "keys"\n', "zenoh.listen[0]"),
        ("udp/127.0.0.1:7448", 'keys = "keys"\n', "zenoh.listen[0]"),
    ],
)
def test_a_link_beyond_this_machine_needs_keys_and_tls(config, listen, keys, said):
    text = config.read_text().replace(f'"{LOCAL}", "tls/0.0.0.0:7448"', f'"{listen}"')
    config.write_text(text.replace('keys = "keys"\n', keys))

    refused = gaitd("gateway", "--config", config)

    assert refused.code == 2
    assert said in refused.err


def test_after_a_power_cut_the_keys_are_those_before_a_command_or_after_it(tmp_path):
    keys = tmp_path / "keys"

    def scenario():
        issuing.init(keys, "trainer", ["trainer.lan"], NOW, 365)
        mark("init")
        issue(keys, "display.desk")
        mark("issue")
        issue(keys, "display.desk")
        mark("renew")
        issue(keys, "session.ward_3", remote=True)
        mark("issue remote")
        issuing.renew_gateway(keys, (), NOW, 100)
        mark("renew gateway")
        issuing.revoke(keys, "display.desk")
        mark("revoke")

    def recover(marks):
        if not (keys / "clients.json").exists():
            assert "init" not in marks
            issuing.init(keys, "trainer", ["trainer.lan"], NOW, 365)
        register = read_keys(keys).register
        listed = {client.name: client.password for client in register.clients}
        bundles = [keys / "issued" / f"{name}{end}" for name in listed for end in ("", ".before")]
        passwords = {
            read_credentials(bundle).file.password
            for bundle in bundles
            if (bundle / "credentials.json").exists()
        }
        assert passwords >= set(listed.values())
        assert ("display.desk" in listed) >= ("issue" in marks and "renew gateway" not in marks)
        assert ("session.ward_3" in listed) >= ("issue remote" in marks)
        assert register.gateway_expires < "2027-06" or "renew gateway" not in marks
        if "revoke" in marks:
            assert set(listed) == {"session.ward_3"}
            assert [path.name for path in (keys / "issued").iterdir()] == ["session.ward_3"]

    check(tmp_path, scenario, recover, random_count=1)
