"""The readable recursions, one file an algorithm: functions of (model, q, ...) on arrays."""
