"""Where methods fail: families of robots and states driven to their limits, against 50 digits."""
