"""Control laws: functions of (t, q, qd) that return joint torques; and the stability of PD gains."""

from .laws import PD, PID, ComputedTorque, Reference, computed_torque, pd, pd_gravity, pid, traceable

__all__ = ["PD", "PID", "ComputedTorque", "Reference", "computed_torque", "pd", "pd_gravity", "pid", "traceable"]


def __dir__() -> list[str]:
    return __all__
