"""Levels as a gateway should not send them: none ends the core, moves a leg or hides a stop."""

import msgspec
import pytest
from records import HEADER

from daemon.record import TEXT_BYTES_MAX, Mode, ModeRequest, Outcome, RequestKind
from daemon.seam import RingWriter

LONG = ("x" * 1800, "\N{GRINNING FACE}" * 1800, "\x00\x1b[2J" * 450)


@pytest.mark.parametrize("name", LONG, ids=["ascii", "four bytes each", "control characters"])
def test_a_name_that_a_refusal_quotes_fits_the_slot_of_its_record(warm_hold, tmp_path, name):
    lockstep = warm_hold.lockstep
    wanted = ModeRequest(Mode.EXCITE, duration_s=10.0, scenario=name)

    answer = lockstep.request(RequestKind.MODE, wanted)

    writer = RingWriter(tmp_path / "some.ring", HEADER)
    for record in lockstep.records[-3:]:
        writer.write(record)
    writer.close()
    assert answer.outcome == Outcome.REFUSED
    assert answer.reason.startswith("scenario = ")
    assert len(answer.reason.encode()) <= TEXT_BYTES_MAX
    assert writer.shortened_count == 0
    assert msgspec.msgpack.encode(lockstep.record)
