"""Role operator: release the plan of a training, and request a mode once the machine is ready."""

import sys

from gaitd_client import Mode, PlanLimits, RequestRefusedError, Trainer


def main(trainer: Trainer) -> None:
    """Release a plan, enable, and let a controller assist."""
    limits = PlanLimits(cadence_max_hz=0.4, amplitude_max_ratio=0.8, duration_max_s=900.0)
    trainer.release_plan(limits)
    try:
        trainer.enable()
        trainer.mode(Mode.TORQUE)
    except RequestRefusedError as error:
        print(error)  # the reason tells what is missing
    print(trainer.status().safety.mode)


if __name__ == "__main__":
    with Trainer(sys.argv[1], credentials=sys.argv[2] if sys.argv[2:] else None) as service:
        main(service)
