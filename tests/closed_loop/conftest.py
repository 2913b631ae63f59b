"""Lock-step sessions that many tests begin with; see `tests/support/forked.py`.

Each is made once for a worker. A test that needs another configuration makes a module's fixture of
its own in the same way, with a name that begins with `warm_`.
"""

import pytest
from gaitd_texts import LANGUAGES, Reader, catalogue
from sessions import generic_drives, new_session, position_guidance

NOISE = "qx7"


@pytest.fixture(scope="module", autouse=True)
def texts_are_noise():
    """No program and no test in this folder reads a sentence: each text is replaced by noise."""
    with pytest.MonkeyPatch.context() as patch:
        for reader in Reader:
            for language in LANGUAGES:
                texts = catalogue(reader, language).texts
                for key in texts:
                    patch.setitem(texts, key, NOISE)
        yield


@pytest.fixture(scope="session")
def warm_ready():
    """The service with the demonstration's configuration, in mode ready."""
    return new_session().until_ready()


@pytest.fixture(scope="session")
def warm_hold():
    """The same, enabled: both axes hold."""
    return new_session().enable()


@pytest.fixture(scope="session")
def warm_gait():
    """The same in the middle of a gait at 0.25 Hz, its ramps behind it."""
    return new_session().walk(duration_s=8.0)


@pytest.fixture
def session(warm_gait):
    """What most tests begin with."""
    return warm_gait


@pytest.fixture(scope="session")
def warm_fast_gait():
    """The same at 0.5 Hz."""
    return new_session().walk(cadence_hz=0.5, duration_s=4.0)


@pytest.fixture(scope="session")
def position_configs(tmp_path_factory):
    return position_guidance(tmp_path_factory.mktemp("position"))


@pytest.fixture(scope="session")
def warm_position_hold(position_configs):
    """Both axes hold by the drives' own loops."""
    return new_session(position_configs).enable()


@pytest.fixture(scope="session")
def warm_position_gait(position_configs):
    """A gait at 0.25 Hz by the drives' own loops."""
    return new_session(position_configs).walk(duration_s=8.0)


@pytest.fixture(scope="session")
def generic_configs(tmp_path_factory):
    return generic_drives(tmp_path_factory.mktemp("generic"))


@pytest.fixture(scope="session")
def warm_generic_hold(generic_configs):
    """Both axes hold with the CiA-standard drives, which go on holding without their master."""
    return new_session(generic_configs).enable()


@pytest.fixture(params=["impedance", "position"])
def guidance(request):
    return request.param


@pytest.fixture
def warm_guided_hold(request, guidance):
    """Held by either guidance."""
    name = "warm_hold" if guidance == "impedance" else "warm_position_hold"
    return request.getfixturevalue(name)


@pytest.fixture
def warm_guided_gait(request, guidance):
    """A gait by either guidance."""
    name = "warm_gait" if guidance == "impedance" else "warm_position_gait"
    return request.getfixturevalue(name)
