"""Role service: look at the drives of the machine, and home those axes that are not referenced."""

import sys

from gaitd_client import Mode, NotValid, RequestRefusedError, Trainer


def main(trainer: Trainer) -> None:
    """Print each drive; request the reference of an axis that has none, in the empty machine."""
    for name in trainer.configuration().drive_names:
        with trainer.drive(name) as drives:
            drive = next(iter(drives))
        if isinstance(drive, NotValid):
            print(f"{name}: {drive.text}")
            continue
        print(f"{name}: {drive.power_state}, {drive.temperature_degc} °C, {drive.emergency_text}")
        if not drive.referenced:
            try:
                trainer.mode(Mode.REFERENCE, axis=name)
            except RequestRefusedError as error:
                print(error)


if __name__ == "__main__":
    with Trainer(sys.argv[1], credentials=sys.argv[2] if sys.argv[2:] else None) as service:
        main(service)
