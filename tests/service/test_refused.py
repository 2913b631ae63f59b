"""A drive that is not the one of the files: how the process ends, and what it leaves on the bus."""

from processes import Service

STRANGER = 0x65510000


def test_a_wrong_product_ends_the_core_with_3_and_both_numbers_and_starts_no_drive(tmp_path):
    service = Service(tmp_path)
    try:
        service.start_drives()
        service.inject(f"wrong_identity right/hip - {STRANGER}")
        with service.listener() as bus:
            core = service.start("core")
            service.wait(lambda: core.poll() is not None, 60)
            sent = []
            while (message := bus.recv(0)) is not None:
                sent.append((message.arbitration_id, bytes(message.data)))
    finally:
        service.end()

    said = service.log("core").splitlines()[-1]
    assert core.returncode == 3
    assert "wrong product (CiA 302 M): drive right/hip 1018h:02 = 65510000h" in said
    assert "expected 61500000h" in said
    assert not [data for can_id, data in sent if can_id == 0x000 and data[0] == 0x01]
    assert not [can_id for can_id, _ in sent if can_id in {0x205, 0x206, 0x305, 0x306}]
