"""Role controller: move the hip of a leg to an angle with a soft spring, while in mode torque."""

import sys

from gaitd_client import Assist, Estimate, Trainer

SPRING_NM_PER_RAD, DAMPER_NM_S_PER_RAD, LIMIT_NM, FURTHER_RAD = 40.0, 4.0, 12.0, 0.1


class Spring:
    """A law: called with each estimate in mode torque or gait, it returns the assist."""

    goal_rad: float | None = None

    def __call__(self, estimate: Estimate) -> Assist:
        """Pull towards the goal; what is not valid is None, and then nothing is asked."""
        angle_rad, speed_rad_per_s = estimate.hip.position, estimate.hip.velocity
        if angle_rad is None or speed_rad_per_s is None:
            return Assist()
        if self.goal_rad is None:
            self.goal_rad = angle_rad + FURTHER_RAD
        pull_nm = SPRING_NM_PER_RAD * (self.goal_rad - angle_rad)
        hip_nm = pull_nm - DAMPER_NM_S_PER_RAD * speed_rad_per_s
        return Assist(hip_nm=min(max(hip_nm, -LIMIT_NM), LIMIT_NM))


def main(trainer: Trainer, duration_s: float) -> None:
    """Hold the lease for a time; an operator requests mode torque, and hold before the end."""
    with trainer.lease("example controller", Spring(), on_refusal=print) as lease:
        lease.wait(duration_s)
        print(f"{lease.answered_count} setpoints sent, refused: {lease.refused_count}")


if __name__ == "__main__":
    with Trainer(sys.argv[1], credentials=sys.argv[3] if sys.argv[3:] else None) as service:
        main(service, float(sys.argv[2]))
