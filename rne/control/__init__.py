"""Control laws: functions of (t, q, qd) that return joint torques; and the stability of PD gains."""

from .adaptive import adaptive
from .adaptive_law import Adaptive
from .laws import PD, PID, pd, pd_gravity, pid, traceable
from .passivity import RobustPassive, SlidingMode, robust_passive, sliding_mode
from .reference import Reference
from .robust import Robust, robust
from .tracking import ComputedTorque, computed_torque
from .uncertainty import Cases, uncertainty_bound

__all__ = [
    "PD",
    "PID",
    "Adaptive",
    "Cases",
    "ComputedTorque",
    "Reference",
    "Robust",
    "RobustPassive",
    "SlidingMode",
    "adaptive",
    "computed_torque",
    "pd",
    "pd_gravity",
    "pid",
    "robust",
    "robust_passive",
    "sliding_mode",
    "traceable",
    "uncertainty_bound",
]


def __dir__() -> list[str]:
    return __all__
