"""Control laws: functions of (t, q, qd) that return joint torques; and the stability of PD gains."""

from .laws import PD, PID, pd, pd_gravity, pid, traceable
from .tracking import ComputedTorque, Reference, computed_torque

__all__ = ["PD", "PID", "ComputedTorque", "Reference", "computed_torque", "pd", "pd_gravity", "pid", "traceable"]


def __dir__() -> list[str]:
    return __all__
