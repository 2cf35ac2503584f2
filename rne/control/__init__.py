"""Control laws: functions of (t, q, qd) that give joint torques; and what their gains imply."""

from .laws import PD, PID, ComputedTorque, Reference, computed_torque, pd, pd_gravity, pid, traceable

__all__ = ["PD", "PID", "ComputedTorque", "Reference", "computed_torque", "pd", "pd_gravity", "pid", "traceable"]


def __dir__() -> list[str]:
    return __all__
