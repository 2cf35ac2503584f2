"""Control laws: functions of (t, q, qd) that return joint torques; the stability of PD gains, and contacts."""

from .adaptive_law import Adaptive, adaptive
from .feedback_loop import FeedbackLoop, LinearisedLoop, closed_loop
from .known_servos import ServoFigures, servo_figures
from .laws import PD, PID, ComputedTorque, Reference, computed_torque, pd, pd_gravity, pid, traceable
from .momentum_observer import MomentumObserver, Residuals
from .observer_law import GuardedLaw, ObserverLaw
from .payload_observer import PayloadObserver, payload_observer
from .robust_laws import Robust, RobustPassive, SlidingMode, robust, robust_passive, sliding_mode
from .servo_law import Servo, servo
from .task_space import Impedance, OperationalSpace, impedance, operational_space
from .traced_law import changed, compiled
from .uncertainty import Cases, uncertainty_bound

__all__ = [
    "PD",
    "PID",
    "Adaptive",
    "Cases",
    "ComputedTorque",
    "FeedbackLoop",
    "GuardedLaw",
    "Impedance",
    "LinearisedLoop",
    "MomentumObserver",
    "ObserverLaw",
    "OperationalSpace",
    "PayloadObserver",
    "Reference",
    "Residuals",
    "Robust",
    "RobustPassive",
    "Servo",
    "ServoFigures",
    "SlidingMode",
    "adaptive",
    "changed",
    "closed_loop",
    "compiled",
    "computed_torque",
    "impedance",
    "operational_space",
    "payload_observer",
    "pd",
    "pd_gravity",
    "pid",
    "robust",
    "robust_passive",
    "servo",
    "servo_figures",
    "sliding_mode",
    "traceable",
    "uncertainty_bound",
]


def __dir__() -> list[str]:
    return __all__
