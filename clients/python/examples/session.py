"""Role session: one training within the released plan, with the figures of each stride."""

import sys

from gaitd_client import Mode, NotValid, Stage, Trainer


def main(trainer: Trainer, duration_s: float) -> None:
    """Play one gait and print its strides; it ends by itself, or by a stop."""
    status = trainer.status()
    plan = status.plan
    if plan is None:
        print("no plan is released")
        return
    with trainer.stride("right") as strides:
        strides.call(lambda stride: isinstance(stride, NotValid) or print(stride.share_ratio))
        if status.safety.mode == Mode.READY:
            trainer.enable()
        trainer.mode(
            Mode.GAIT,
            cadence_hz=plan.cadence_max_hz,
            amplitude_ratio=plan.amplitude_max_ratio,
            duration_s=duration_s,
        )
        for safety in trainer.safety():
            if isinstance(safety, NotValid):
                print(safety.text)
            elif safety.mode != Mode.GAIT or safety.stage == Stage.OVER:
                break
            else:
                print(safety.progress)
    print(trainer.status().safety.mode)


if __name__ == "__main__":
    with Trainer(sys.argv[1], credentials=sys.argv[3] if sys.argv[3:] else None) as service:
        main(service, float(sys.argv[2]))
