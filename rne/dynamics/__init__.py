"""The readable recursions, one file per algorithm: functions of (model, q, ...) on arrays."""
