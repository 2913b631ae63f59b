"""What is damaged on its way to the gateway costs what is damaged, and nothing else."""

from daemon import seam


def spoil(bench, seq, data=b"\xff" * 40):
    """Bytes in the middle of a record of the core's ring."""
    with (bench.runtime / seam.RING_NAME).open("r+b") as file:
        file.seek(seam.HEADER_SIZE + seq % seam.SLOT_COUNT * seam.SLOT_SIZE + 12)
        file.write(data)


def test_a_record_that_cannot_be_read_is_left_out_counted_and_told(bench):
    bench.cycle()
    for _ in range(3):
        bench.write()
    spoil(bench, 3)

    bench.turn()
    for _ in range(100):
        bench.cycle()

    said = [message.cycle for message in bench.outlet.on("right/activity")]
    told = [event.text for event in bench.outlet.events if "cannot be read" in event.text]
    assert said == [1, 2, *range(4, 105)]
    assert told == ["records of the core cannot be read, 1 so far: damaged, or of another gaitd"]
    assert bench.outlet.on("health")[-1].record_missed_count == 1


def test_a_slot_whose_number_is_lost_does_not_hold_up_the_records_after_it(bench):
    bench.cycle()
    bench.write()
    with (bench.runtime / seam.RING_NAME).open("r+b") as file:
        file.seek(seam.HEADER_SIZE + 2 * seam.SLOT_SIZE)
        file.write(bytes(8))
    bench.write()

    bench.turn()

    assert [message.cycle for message in bench.outlet.on("right/activity")] == [1, 3]
